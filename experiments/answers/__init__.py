"""What `sinan` answers, as objects: the functions that the command line and `import sinan` both call."""
