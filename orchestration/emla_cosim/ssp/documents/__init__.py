"""The files of an SSP as plain data, read from XML and written to XML."""
