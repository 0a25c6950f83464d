"""The policy bundles that are shipped, a folder each with its model card; the default policy is one."""
