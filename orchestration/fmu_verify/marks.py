"""Recognize files with a report of `verify`, which may be overwritten."""

from emla_cosim.base.output_files import has_format, has_mark

JSON_FORMAT = "emla-verify"

is_json = has_format(JSON_FORMAT)
is_junit = has_mark(b'<testsuites name="emla verify"')
