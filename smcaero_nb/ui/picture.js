// Curves drawn by plotly.js, which is loaded once a page.
const beside = (model, name) => model.widget_manager.get_model(model.get(name).slice("IPY_MODEL_".length));
const load = async model => {
  const code = await beside(model, "code");
  const made = { exports: {} };
  new Function("module", "exports", "define", code.get("text"))(made, made.exports, undefined);
  return made.exports;
};
const numbers = view => new Float32Array(view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength));

const loaded = model => globalThis.smcaeroPlotly ??= load(model).catch(error => {
  globalThis.smcaeroPlotly = undefined;  // the next picture tries again
  throw error;
});

async function render({ model, el }) {
  const box = document.createElement("div");
  el.classList.add("smcaero-picture");
  el.appendChild(box);
  const plotly = await loaded(model), [curves, view] = await Promise.all(["curves", "view"].map(q => beside(model, q)));
  if (["localhost", "127.0.0.1", "[::1]"].includes(location.hostname) && !view.get("near")) {
    view.set("near", true);
    view.save_changes();
  }

  // What a plot of several columns leaves between them: room for titles and numbers, however narrow it is.
  const spread = (layout, width) => {
    const columns = layout.meta?.columns ?? 1, inner = width - layout.margin?.l - layout.margin?.r;
    if (!(columns > 1 && inner > 0)) return;
    const apart = Math.max(layout.meta.apart, Math.min(84/inner, 0.4)), wide = (1 + apart)/columns - apart;
    const left = n => ((n || 1) - 1) % columns*(wide + apart);
    for (const [name, axis] of Object.entries(layout)) {
      const [, kind, n] = name.match(/^(xaxis|legend)(\d*)$/) ?? [];
      if (kind === "xaxis") axis.domain = [left(n), left(n) + wide];
      if (kind === "legend" && axis.xanchor === "right") axis.x = left(n) + wide;
    }
  };
  const grey = (trace, x, y) => ({
    ...trace, x: numbers(x), y: numbers(y), meta: `before:${trace.meta}`, showlegend: false, hoverinfo: "skip",
    hovertemplate: undefined, line: { ...trace.line, color: "#c4c4c4", width: 1.2, dash: "solid" },
  });
  const described = layout => box.querySelectorAll(".main-svg").forEach((svg, i) => {
    if (i) svg.setAttribute("aria-hidden", "true");
    else { svg.setAttribute("role", "img"); svg.setAttribute("aria-label", layout.meta?.alt ?? "Curves") }
  });

  // One message may change all; they are drawn when it has been read.
  let asked = false;
  const draw = () => {
    asked = false;
    const { traces, layout } = curves.get("drawing"), x = curves.get("x"), y = curves.get("y"), width = el.clientWidth;
    if (!width || !traces || x.length !== traces.length || y.length !== traces.length) return;
    const data = traces.map((t, i) => ({  // what is not a number stays in the trace
      ...t, ...(x[i].byteLength && { x: numbers(x[i]) }), ...(y[i].byteLength && { y: numbers(y[i]) }),
    }));
    const before = curves.get("behind").map(([n, x, y]) => grey(traces[n], x, y)), shown = { ...structuredClone(layout), width };
    spread(shown, width);
    plotly.react(box, [...before, ...data], shown, { displaylogo: false, showSendToCloud: false });
    if (!box.zoomed) box.zoomed = box.on("plotly_relayout", zoomed) && true;
    described(layout);
  };
  const later = () => { if (!asked) { asked = true; queueMicrotask(draw); } };
  const changes = "change:drawing change:x change:y change:behind";
  curves.on(changes, later);
  const marked = () => { el.dataset.state = curves.get("state") };
  curves.on("change:state", marked);
  marked();

  // What is zoomed to is recorded anew by the kernel, when the hand rests.
  let resting;
  function zoomed(change) {
    if (!Object.keys(change).some(k => k.startsWith("xaxis"))) return;
    clearTimeout(resting);
    resting = setTimeout(() => {
      const { autorange, range } = box._fullLayout.xaxis;
      view.set("span", autorange ? [] : range.map(Number));
      view.save_changes();
    }, 150);
  }

  // Not plotly's own fit to the page, which forgets the height. It also tells that a hidden picture, not drawn, is seen again.
  const fitter = new ResizeObserver(later);
  fitter.observe(el);
  return () => { fitter.disconnect(); curves.off(changes, later); curves.off("change:state", marked); plotly.purge(box); };
}
export default { render };
