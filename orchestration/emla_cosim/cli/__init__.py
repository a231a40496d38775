"""The `emla` command: the program, its options and commands, shell completion."""
