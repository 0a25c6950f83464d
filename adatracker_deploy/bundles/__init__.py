"""The policy bundles that are shipped, one folder each; none yet, so that `pid` is the default policy."""
