"""The command line, a file for each command. Imports whatever a command needs, when it runs."""
