"""The use cases: each a function that a program, the command line or the page calls."""
