"""HTML of the report: pieces of the page and its style. Every text from outside is escaped here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import NamedTuple

_BADGES = {
    "kept": ("good", "Improved and kept"),
    "host_only": ("warn", "Not in the drive: only with a host"),
    "checked": ("good", "Checked"),
    "stage": ("info", "Stage done, nothing written"),
    "rolled_back": ("warn", "Rolled back"),
    "not_applied": ("warn", "Nothing applied"),
    "proved": ("info", "Proved, not written"),
    "aborted": ("bad", "Stopped"),
    "information": ("info", "For information"),
}


class Shown(NamedTuple):
    """A number before and after, ready to be shown."""

    name: str
    before: str | None
    after: str | None
    unit: str
    factor: str
    note: str


def document(title: str, body: str, script: str) -> str:
    """The whole page; `script` (plotly's) stands before the figures that need it."""
    embedded = f"<script>{script}</script>\n<script>{_PRINTING}</script>" if script else ""
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light">\n<meta name="generator" content="autotune">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n{embedded}\n</head>\n"
        f"<body>\n<main>\n{body}\n</main>\n</body>\n</html>\n"
    )


def head(title: str, subtitle: str) -> str:
    below = f'<p class="subtitle">{escape(subtitle)}</p>' if subtitle else ""
    return f"<header><h1>{escape(title)}</h1>{below}</header>"


def verdict(outcome: str, text: str) -> str:
    kind, badge = _BADGES[outcome]
    return (
        f'<section class="verdict {kind}" aria-label="Verdict"><span class="badge">{badge}</span>'
        f"<p>{escape(text)}</p></section>"
    )


def changes(shown: Sequence[Shown]) -> str:
    if not shown:
        return ""
    return f'<section class="changes">{"".join(_change(change) for change in shown)}</section>'


def steps(texts: Sequence[str]) -> str:
    if not texts:
        return ""
    items = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f'<section class="next"><h2>What to do next</h2><ol>{items}</ol></section>'


def picture(number: int, title: str, caption: str, body: str) -> str:
    """`body` is HTML made by plotly, which escapes what it embeds."""
    return (
        f"<figure><h2>{escape(title)}</h2>{body}<figcaption><b>Figure {number}.</b> {escape(caption)}"
        "</figcaption></figure>"
    )


def table(
    title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], note: str, numeric: frozenset[int]
) -> str:
    kind = ['class="number"' if index in numeric else "" for index in range(len(columns))]
    header = "".join(f"<th {k}>{escape(name)}</th>" for k, name in zip(kind, columns, strict=True))
    body = "".join(
        "<tr>" + "".join(_cell(k, name, c) for k, name, c in zip(kind, columns, row, strict=True)) + "</tr>"
        for row in rows
    )
    below = f'<p class="note">{escape(note)}</p>' if note else ""
    return (
        f'<section class="table"><h2>{escape(title)}</h2><div class="scroll"><table><thead><tr>{header}</tr>'
        f"</thead><tbody>{body}</tbody></table></div>{below}</section>"
    )


def _cell(kind: str, column: str, text: str) -> str:
    """The column's name goes with each cell: on a narrow screen a row becomes a list."""
    return f'<td {kind} data-column="{escape(column)}">{escape(text)}</td>'


def facts(title: str, pairs: Mapping[str, str]) -> str:
    if not pairs:
        return ""
    items = "".join(f"<div><dt>{escape(k)}</dt><dd>{escape(v)}</dd></div>" for k, v in pairs.items())
    return f'<section class="facts"><h2>{escape(title)}</h2><dl>{items}</dl></section>'


def machine_readable(text: str) -> str:
    return (
        '<section class="machine"><details><summary>The same for machines (JSON)</summary>'
        f'<pre id="data">{escape(text, quote=False)}</pre></details></section>'
    )


def sign_off() -> str:
    lines = "".join(
        f"<div><span></span><small>{label}</small></div>" for label in ("Date", "Name", "Signature")
    )
    return (
        '<section class="sign"><h2>Accepted</h2><p>The axis was inspected in motion, and the values above '
        f'may stay in the drive.</p><div class="lines">{lines}</div></section>'
    )


def _change(change: Shown) -> str:
    before = _value("before", change.before, change.unit)
    after = _value("after", change.after, change.unit)
    if before and after:  # the arrow stays with what it points at where the pair takes two lines
        after = f'<div class="then"><span class="arrow" aria-hidden="true">→</span>{after}</div>'
    factor = f'<p class="factor">{escape(change.factor)}</p>' if change.factor else ""
    note = f'<p class="note">{escape(change.note)}</p>' if change.note else ""
    return (
        f'<div class="change"><h3>{escape(change.name)}</h3><div class="pair">{before}{after}</div>'
        f"{factor}{note}</div>"
    )


def _value(kind: str, value: str | None, unit: str) -> str:
    if value is None:
        return ""
    return (
        f'<div class="{kind}"><small>{kind}</small><span class="value">{escape(value)}</span> '
        f'<span class="unit">{escape(unit)}</span></div>'
    )


_STYLE = """
:root{--ink:#1f2933;--muted:#5f6b7a;--line:#dde2e9;--before:#b84f00;--after:#0072b2;--good:#00694d;
--warn:#8a5a00;--bad:#a3271b;--info:#2f5d8a}
*{box-sizing:border-box}
body{margin:0;background:#f4f6f8;color:var(--ink);
font:16px/1.5 system-ui,-apple-system,'Segoe UI',Roboto,'Helvetica Neue',Arial,sans-serif}
main{max-width:1000px;margin:0 auto;padding:28px 20px 60px}
h1{font-size:1.75rem;margin:0;overflow-wrap:anywhere}h2{font-size:1.1rem;margin:0 0 .5rem}
h3{font-size:.95rem;margin:0 0 .4rem;color:var(--muted);font-weight:600}
.subtitle{margin:.2rem 0 0;color:var(--muted)}
section,figure{background:#fff;border:1px solid var(--line);border-radius:8px;padding:18px 20px;margin:16px 0}
.verdict{border-left:6px solid var(--info)}.verdict p{font-size:1.2rem;margin:.5rem 0 0;white-space:pre-line}
.badge{display:inline-block;color:#fff;background:var(--info);border-radius:4px;padding:2px 10px;
font-weight:600;font-size:.9rem}
.good{border-left-color:var(--good)}.good .badge{background:var(--good)}
.warn{border-left-color:var(--warn)}.warn .badge{background:var(--warn)}
.bad{border-left-color:var(--bad)}.bad .badge{background:var(--bad)}
.changes{display:grid;grid-template-columns:repeat(auto-fit,minmax(340px,1fr));gap:20px}
.pair{display:flex;align-items:flex-end;gap:10px;flex-wrap:wrap}.then{display:flex;align-items:flex-end;gap:10px}
.pair small{display:block;color:var(--muted);font-size:.8rem}
.value{font-size:2rem;font-weight:700;line-height:1.1;font-variant-numeric:tabular-nums}
.before .value{color:var(--before)}.after .value{color:var(--after)}
.unit{color:var(--muted)}.arrow{font-size:1.6rem;color:var(--muted);padding-bottom:4px}
.factor{margin:.4rem 0 0;font-weight:600}.note{margin:.4rem 0 0;color:var(--muted);font-size:.9rem}
.next ol{margin:0;padding-left:1.3rem}.next li{margin:.2rem 0}
figure{break-inside:avoid}figcaption{color:var(--muted);font-size:.95rem;margin-top:.4rem}
.scroll{overflow-x:auto}table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
th{color:var(--muted);font-weight:600;font-size:.9rem;border-bottom:2px solid var(--line)}
th,td{text-align:left;padding:6px 12px 6px 0;vertical-align:top}td{border-bottom:1px solid var(--line)}
th.number,td.number{text-align:right;white-space:nowrap}
dl{margin:0;display:grid;grid-template-columns:repeat(auto-fill,minmax(270px,1fr));gap:0 24px}
dl div{display:flex;justify-content:space-between;gap:12px;border-bottom:1px solid var(--line);padding:5px 0}
dt{color:var(--muted)}dd{margin:0;text-align:right;overflow-wrap:anywhere}
summary{cursor:pointer;color:var(--muted)}pre{overflow:auto;font-size:.85rem;max-height:480px}
.lines{display:grid;grid-template-columns:1fr 2fr 2fr;gap:28px;margin-top:44px}
.lines span{display:block;border-bottom:1.5px solid var(--ink)}.lines small{color:var(--muted)}
@media (max-width:640px){main{padding:12px 8px 40px}section,figure{padding:12px 12px}
h1{font-size:1.4rem}.verdict p{font-size:1.05rem}.value{font-size:1.7rem}
.changes,dl{grid-template-columns:minmax(0,1fr)}
dl div{flex-wrap:wrap}p,td,dd,figcaption,small{overflow-wrap:anywhere}
thead{display:none}table,tbody,tr,td{display:block;width:100%}tr{border-bottom:2px solid var(--line);padding:4px 0}
td,td.number{border:0;padding:2px 0;text-align:left;white-space:normal}td:empty{display:none}
td[data-column]:not([data-column=""])::before{content:attr(data-column) ": ";color:var(--muted)}
pre{white-space:pre-wrap;overflow-wrap:anywhere}.modebar-container{display:none}.lines{grid-template-columns:1fr;gap:34px}}
@page{size:A4;margin:14mm}
@media print{body{background:#fff;font-size:11pt}main{max-width:none;padding:0}
section,figure{border:0;border-radius:0;padding:0;margin:0 0 7mm;break-inside:avoid}
.scroll{overflow:visible}table{font-size:9pt}th,td{padding:3px 7px 3px 0}
th.number,td.number{white-space:normal}td:not(.number){min-width:24mm}
.changes{grid-template-columns:1fr 1fr}.value{font-size:1.6rem}
.table{break-inside:auto}tr,dl div{break-inside:avoid}h2{break-after:avoid}
figure>div,.plotly-graph-div{height:auto!important}
.verdict{padding:2mm 4mm;border-left-style:solid;
border-left-width:6px}.machine,.modebar-container{display:none}
*{-webkit-print-color-adjust:exact;print-color-adjust:exact}}
"""

_PRINTING = """
(function(){function all(f){document.querySelectorAll('.plotly-graph-div').forEach(f)}
function narrow(){all(function(d){d.tall=d.layout.height;Plotly.relayout(d,{width:680,
height:Math.max(240,0.8*d.tall),autosize:false})})}
function wide(){all(function(d){Plotly.relayout(d,{width:null,height:d.tall,
autosize:true})})}
window.addEventListener('beforeprint',narrow);window.addEventListener('afterprint',wide)})();
"""
