"""The command line octo-arm: a file for each command, and the options that commands share."""
