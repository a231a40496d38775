from .findings import Examined as Examined
from .findings import Finding as Finding
from .report import Report as Report
from .runner import verify as verify
from .settings import Recording as Recording
from .verdict import Verdict as Verdict
