"""The command line octo-arm: one file for each command, and the options that they share."""
