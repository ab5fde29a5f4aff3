"""Reports: one self-contained HTML file a subject, and an index of a dataset."""

from __future__ import annotations

from kiribench.report.index import report_name, write_index
from kiribench.report.page import write_subject_report
from kiribench.report.subject import SubjectReport

__all__ = ["SubjectReport", "report_name", "write_index", "write_subject_report"]
