"""The use cases, one function each, for programs, the command line and the page."""
