"""The segmenter that comes with the toolkit: small models that two processor cores can run beside the loop."""
