"""Machine files, and the machines that come with the study."""
