"""What an FMU, a package or a scenario is made of: FMUs, variables, what drives them, what can be set."""
