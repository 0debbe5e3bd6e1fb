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
  const plotly = await loaded(model), curves = await beside(model, "curves");
  if (["localhost", "127.0.0.1", "[::1]"].includes(location.hostname) && !curves.get("near")) {
    curves.set("near", true);
    curves.save_changes();
  }

  // One message may change all three; they are drawn when it has been read.
  let asked = false;
  const draw = () => {
    asked = false;
    const { traces, layout } = curves.get("drawing"), x = curves.get("x"), y = curves.get("y"), width = el.clientWidth;
    if (!width || !traces || x.length !== traces.length || y.length !== traces.length) return;
    const data = traces.map((t, i) => ({  // what is not a number stays in the trace
      ...t, ...(x[i].byteLength && { x: numbers(x[i]) }), ...(y[i].byteLength && { y: numbers(y[i]) }),
    }));
    plotly.react(box, data, { ...structuredClone(layout), width }, { displaylogo: false });
  };
  const later = () => { if (!asked) { asked = true; queueMicrotask(draw); } };
  const changes = "change:drawing change:x change:y";
  curves.on(changes, later);

  // Not plotly's own fit to the page, which forgets the height. It also tells that a hidden picture, not drawn, is seen again.
  const fitter = new ResizeObserver(later);
  fitter.observe(el);
  return () => { fitter.disconnect(); curves.off(changes, later); plotly.purge(box); };
}
export default { render };
