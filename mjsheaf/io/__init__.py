"""Files: YAML that people write, and what the commands leave, whole or not at all."""
