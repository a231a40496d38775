"""The tools that are measured, a module each; every module can be run by itself with a job file."""
