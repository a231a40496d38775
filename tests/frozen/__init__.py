"""What users rely on and must not change while code is rebuilt: `python -m tests.frozen` writes it anew."""
