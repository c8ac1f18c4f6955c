"""Files: YAML that users write, and what the commands leave, whole or not at all.

Where to look: section (pydantic models and their error messages), yaml (safe loading, editing), files (atomic writing).
"""
