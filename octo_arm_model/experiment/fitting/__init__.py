"""Parameters of an arm from measured shapes. Imports recording and core."""
