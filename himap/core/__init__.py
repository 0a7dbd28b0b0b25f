"""Used by all other packages: errors, checks, the survey, files and progress."""
