"""What every room stands on: errors, checks, the survey, files and progress."""
