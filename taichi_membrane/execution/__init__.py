"""A scene carried out from beginning to end: load steps, files, pictures, checks; and going on with a run that was stopped."""
