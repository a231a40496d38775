"""What every other room builds on: errors, values, units, quantities, files, options as a mechanism."""
