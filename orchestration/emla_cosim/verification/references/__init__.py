"""Reference files of FMUs: found, read, followed and made."""
