"""Both ends of the wire: topics, messages, quality of service, and a node with its thread."""
