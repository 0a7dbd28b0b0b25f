"""What all other packages use: errors, checks, the survey, files and progress."""
