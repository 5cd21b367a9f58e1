"""Input and output: files, and objects of other libraries, are converted to data objects and back."""
