"""Draw the verdict as a badge: an SVG image that a pipeline stores, and that a README shows."""

from xml.sax.saxutils import escape

from emla_cosim.base.wording import format_count

from .check import Verdict
from .findings import Findings
from .report_files import BADGE_MARK

# width of a letter in px; `textLength` makes it so with any font
_WIDTH = 6.6

_PASSED, _FAILED, _INCOMPLETE = "#2a7d2a", "#c0322b", "#6b6b6b"

_IMAGE = """\
<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="20" role="img" aria-label="{text}">
<title>{text}</title>{mark}
<clipPath id="r"><rect width="{width}" height="20" rx="3"/></clipPath>
<g clip-path="url(#r)"><rect width="{left}" height="20" fill="#444"/>
<rect x="{left}" width="{right}" height="20" fill="{color}"/></g>
<g fill="#fff" font-family="Verdana,DejaVu Sans,sans-serif" font-size="11">
<text x="6" y="14" textLength="{label_width}">{label}</text>
<text x="{start}" y="14" textLength="{message_width}">{message}</text></g>
</svg>
"""


def render(report: Findings) -> str:
    """Return the badge as SVG."""
    count = len(report.examined)
    label = "FMU" if count == 1 else format_count(count, "FMU")
    message, color = describe_badge(report)
    label_width, message_width = (round(len(text) * _WIDTH) for text in (label, message))
    label_box_width, message_box_width = label_width + 12, message_width + 12
    return _IMAGE.format(
        width=label_box_width + message_box_width,
        text=escape(f"{label}: {message}"),
        mark=BADGE_MARK,
        left=label_box_width,
        right=message_box_width,
        color=color,
        start=label_box_width + 6,
        label_width=label_width,
        message_width=message_width,
        label=label,
        message=message,
    )


def describe_badge(report: Findings) -> tuple[str, str]:
    """Return the message and the color."""
    counts = report.counts
    if not report.complete:
        return "incomplete", _INCOMPLETE
    if failed := counts[Verdict.FAILED]:
        return f"{format_count(failed, 'check')} failed", _FAILED
    if not report.passed:
        return "not passed", _FAILED
    passed_count = counts[Verdict.PASSED] + counts[Verdict.WARNING]
    return f"{format_count(passed_count, 'check')} passed", _PASSED
