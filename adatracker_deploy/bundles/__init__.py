"""The policy bundles that are shipped, a folder each with its model card; `pid` stays the default policy."""
