"""The policy bundles that are shipped, one folder each with its model card; `pid` stays the default policy."""
