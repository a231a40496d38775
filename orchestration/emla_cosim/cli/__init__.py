"""The `emla` command: the program, its options and commands, completion in shells."""
