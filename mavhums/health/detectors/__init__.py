"""One module for each fault, with a class named ``Detector``; found by themselves."""
