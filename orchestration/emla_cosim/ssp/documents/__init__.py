"""The files of an SSP as plain data, from XML and to XML."""
