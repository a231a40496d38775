"""What all analyses share: plans, folders, tables and pages."""
