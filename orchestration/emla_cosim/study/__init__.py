"""What is specific to this project's machine: joints, their roles, metrics, figures and scenarios."""
