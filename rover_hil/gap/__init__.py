"""The model-gap workflow: find where model and measurement disagree, name what is missing, prove it."""
