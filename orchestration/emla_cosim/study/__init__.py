"""What is special to this project's machine: joints, their roles, metrics, figures and scenarios."""
