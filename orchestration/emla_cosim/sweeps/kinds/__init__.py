"""Kinds of distributions: how one quantity varies from variant to variant."""
