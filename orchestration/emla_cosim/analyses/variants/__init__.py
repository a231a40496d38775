"""Variants of a scenario: what varies, how it is drawn, and what is measured."""
