"""`report.html`: `page` puts it together, `curves` decides what is drawn, `charts` draws."""

from fractal_farm.farm.report.page import report_page, write_report

__all__ = ["report_page", "write_report"]
