"""The shipped policy bundles, one folder each with its model card, including the default policy."""
