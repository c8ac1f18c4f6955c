"""Files: YAML that users write, and what the commands leave, whole or not at all.

Modules: section (pydantic models and their error messages), yaml (safe loading, editing), files (atomic writing).
"""
