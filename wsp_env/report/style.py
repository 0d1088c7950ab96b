"""How pages look, and the little they do by themselves."""

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; max-width: 1080px; margin: 1.4rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: .3rem; } h2 { font-size: 1.25rem; margin: 2.2rem 0 .4rem; }
p { max-width: 46rem; } .lead { font-size: 1.15rem; max-width: 58rem; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .6rem 0; }
th, td { padding: .25rem .8rem; text-align: right; border-bottom: 1px solid #ddd; } th { background: #f4f4f4; }
th:first-child, td:first-child { text-align: left; } caption { caption-side: bottom; text-align: left; color: #666; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .15rem 1.2rem; margin: .6rem 0; max-width: 66rem; }
dt { color: #666; } dd { margin: 0; }
.still svg { max-width: 100%; height: auto; } .missing { color: #777; border: 1px dashed #bbb; padding: .5rem .8rem; }
details { border-top: 1px solid #ddd; padding: .5rem 0; } summary { cursor: pointer; }
summary h2 { display: inline; font-size: 1.1rem; margin: 0; }
footer { white-space: pre-line; overflow-wrap: anywhere; margin-top: 2.5rem; color: #777; font-size: .8rem; }
@media print {
  body { max-width: none; margin: 0; } .plot, tr { break-inside: avoid; } h2, summary { break-after: avoid; }
  summary { list-style: none; } .modebar { display: none !important; }
}
"""

#: A plot is drawn when it is first seen; on paper all folds are open.
SCRIPT = """
const drawn = new Set();
function draw(plot) {
  const target = plot.querySelector(".live");
  if (!window.Plotly) { plot.style.minHeight = 0; return; }
  if (drawn.has(plot)) { Plotly.Plots.resize(target); return; }
  drawn.add(plot);
  plot.querySelector(".still").remove();
  const {data, layout} = JSON.parse(plot.querySelector("script").textContent);
  Plotly.newPlot(target, data, layout, {displaylogo: false, responsive: true});
}
const folds = [...document.querySelectorAll("details")];
const inside = fold => fold.querySelectorAll(".plot").forEach(draw);
document.querySelectorAll(".plot").forEach(plot => plot.closest("details:not([open])") || draw(plot));
folds.forEach(fold => fold.addEventListener("toggle", () => fold.open && inside(fold)));
addEventListener("beforeprint", () => folds.forEach(fold => { fold.open = true; inside(fold); }));
"""
