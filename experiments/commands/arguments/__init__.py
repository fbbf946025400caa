"""The arguments of each command, one file a command; its work is imported when it runs."""
