"""A certificate as a page for people: one HTML file without any request, light and dark (DESIGN section 6, point 5)."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape

from fractal_farm.solid.certificate import Certificate
from fractal_farm.solid.findings import box_text, place_text
from fractal_farm.solid.materials import Material

_STYLE = """
:root { color-scheme: light dark; --ink: #1c1e22; --paper: #fbfbf9; --line: #d5d5d0; --good: #1d7a3e; --bad: #b3261e;
  --care: #8a5a00; --soft: #62656c; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e6e3; --paper: #15171b; --line: #383b42; --good: #6fd08f;
  --bad: #ff8a80; --care: #ffc56b; --soft: #a2a6ae; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper); margin: 2rem auto;
  max-width: 60rem; padding: 0 1rem; }
h1 { margin-bottom: 0; } h2 { margin-top: 2rem; } p.soft, td.soft, figcaption { color: var(--soft); }
.pass { color: var(--good); } .failure, .fail { color: var(--bad); } .warning { color: var(--care); }
table { border-collapse: collapse; width: 100%; } td, th { text-align: left; vertical-align: top; padding: .3rem .6rem;
  border-bottom: 1px solid var(--line); }
td.figure { font-variant-numeric: tabular-nums; white-space: nowrap; }
.pictures { display: flex; flex-wrap: wrap; gap: 1rem; } figure { margin: 0; flex: 1 1 18rem; }
img { width: 100%; border-radius: 6px; } code { overflow-wrap: anywhere; font-size: .85em; }
"""


def certificate_page(
    certificate: Certificate, material: Material, title: str, pictures: Sequence[tuple[str, bytes]] = ()
) -> str:
    """The page.

    Args:
        certificate: what it shows.
        material: by which it was judged.
        title: what was examined, such as the name of the file.
        pictures: caption and PNG of each.

    Returns:
        A whole HTML document; what comes from files is escaped.
    """
    verdict = "passes" if certificate.passes else "does not pass"
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{escape(title)}: {verdict}</title><style>{_STYLE}</style></head><body>\n"
        f"<h1>{escape(title)} <span class='{certificate.verdict}'>{verdict}</span></h1>\n"
        f"<p class='soft'>{escape(material.title)}. Limits: {escape(material.source)} ({escape(material.date)}).</p>\n"
        f"{_pictures(pictures)}{_findings(certificate)}{_facts(certificate, material)}{_origin(certificate)}"
        "</body></html>\n"
    )


def _pictures(pictures: Sequence[tuple[str, bytes]]) -> str:
    figures = "".join(
        f"<figure><img alt='{escape(caption)}' src='data:image/png;base64,{base64.b64encode(content).decode()}'>"
        f"<figcaption>{escape(caption)}</figcaption></figure>"
        for caption, content in pictures
    )
    return f"<div class='pictures'>{figures}</div>\n" if figures else ""


def _findings(certificate: Certificate) -> str:
    if not certificate.findings:
        return "<h2>Findings</h2><p>None.</p>\n"
    rows = "".join(
        f"<tr><td class='{finding.severity}'>{finding.severity}</td><td>It {escape(finding.what)}: "
        f"{escape(finding.how_much)}</td>"
        f"<td class='figure'>{'<br>'.join(map(place_text, finding.where)) or '-'}</td>"
        f"<td>{escape(finding.remedy)}</td></tr>"
        for finding in certificate.findings
    )
    head = "<tr><th></th><th>what</th><th>where, mm</th><th>what would help</th></tr>"
    return f"<h2>Findings</h2>\n<table>{head}{rows}</table>\n"


def _facts(certificate: Certificate, material: Material) -> str:
    thickest = certificate.thickest
    ball = "-" if thickest is None else f"{thickest.diameter_mm:.2f} mm (to {thickest.error_mm:.1f} mm more)"
    rows = (
        ("surface", "closed" if certificate.closed else "not closed", "closed"),
        ("manifold", certificate.manifold, "NoError"),
        ("bodies", str(certificate.n_bodies), "1"),
        ("closed cavities", str(certificate.n_cavities), "0"),
        (
            "wall that 99 % of the surface reach",
            _figure(certificate.wall_mm, "mm"),
            f">= {certificate.wall_limit_mm:.2f} mm",
        ),
        ("thin places", str(len(certificate.thin_places)), "0"),
        ("thickest solid", ball, f"<= {material.solid:g} mm"),
        ("box", f"{box_text(certificate.box_mm)} mm", _box_limit(material)),
        ("volume", _figure(certificate.volume_mm3, "mm3"), ""),
        ("surface area", _figure(certificate.area_mm2, "mm2"), ""),
        ("mass", _figure(certificate.grams, "g"), ""),
        ("mass after polishing", _figure(certificate.grams_polished, "g"), ""),
        ("overhang above 45 degrees", f"{certificate.overhang_share:.1%} of the surface", ""),
        ("handles (genus)", "-" if certificate.genus is None else str(certificate.genus), ""),
        ("faces", f"{certificate.faces:,}", ""),
    )
    body = "".join(
        f"<tr><td>{escape(name)}</td><td class='figure'>{escape(value)}</td><td class='soft'>{escape(limit)}</td></tr>"
        for name, value, limit in rows
    )
    return f"<h2>Facts</h2>\n<table><tr><th></th><th>measured</th><th>limit</th></tr>{body}</table>\n"


def _origin(certificate: Certificate) -> str:
    lines = [f"mesh sha256 <code>{certificate.mesh_sha256}</code>"]
    if certificate.design_id is not None:
        lines.append(f"design <code>{escape(certificate.design_id)}</code>")
    if certificate.software is not None:
        lines.append(f"made by {escape(certificate.software)}")
    lines.append(f"certified by {escape(certificate.certified_by)}")
    return f"<p class='soft'>{'<br>'.join(lines)}</p>\n"


def _figure(value: float | None, unit: str) -> str:
    return "-" if value is None else f"{value:.4g} {unit}"


def _box_limit(material: Material) -> str:
    limits = [f"sides >= {material.smallest_side:g} mm"] if material.smallest_side else []
    limits += [f"sum >= {material.sum_of_sides:g} mm"] if material.sum_of_sides else []
    return ", ".join(limits)
