from .check import Verdict as Verdict
from .findings import Examined as Examined
from .findings import Finding as Finding
from .report import Report as Report
from .runner import verify as verify
from .settings import Recording as Recording
