"""Files: YAML from users, and atomic output of the commands.

Modules: section (pydantic models and their error messages), yaml (safe loading, editing), files (atomic writing).
"""
