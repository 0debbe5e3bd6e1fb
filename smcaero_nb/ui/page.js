// What ipywidgets and plotly leave out in the page.
function render({ model, el }) {
  el.style.display = "none";
  let observer, fitter, timer, watch;

  const start = () => {
    const mask = el.closest(".smcaero-mask, .smcaero-study");
    if (!mask) { timer = setTimeout(start, 50); return; }

    // Accessible names and states: slider handles, text entries, groups that open, messages.
    const name = () => {
      for (const [key, [text, log]] of Object.entries(model.get("names"))) {
        const row = mask.querySelector(`.smcaero-set-${CSS.escape(key)}`);
        if (!row) continue;
        row.querySelectorAll("[role=slider], input").forEach(e => e.setAttribute("aria-label", text));
        if (log) row.querySelectorAll("[role=slider]").forEach(e =>
          e.setAttribute("aria-valuetext", String(Number((10 ** e.getAttribute("aria-valuenow")).toPrecision(3)))));
        row.querySelectorAll("input[type=text]").forEach(e => e.setAttribute("aria-invalid", row.classList.contains("smcaero-refused")));
      }
      mask.querySelectorAll(".smcaero-fold, .smcaero-help").forEach(e => e.setAttribute("aria-expanded", e.classList.contains("mod-active")));
      mask.querySelectorAll(".smcaero-choice select").forEach(e => e.setAttribute("aria-label", "closed loop"));
      mask.querySelectorAll(".smcaero-doc, .smcaero-doc mjx-container[display=true]").forEach(e => e.setAttribute("tabindex", "0"));
      mask.querySelectorAll(".smcaero-status").forEach(e => { e.setAttribute("role", "status"); e.setAttribute("aria-live", "polite"); });
      mask.querySelectorAll(".smcaero-busy [role=progressbar], .smcaero-busy .progress").forEach(e => e.setAttribute("aria-label", "progress of the run"));
    };
    let asked = false;
    const later = () => { if (!asked) { asked = true; requestAnimationFrame(() => { asked = false; name(); }); } };
    observer = new MutationObserver(later);
    observer.observe(mask, { childList: true, subtree: true, attributes: true, attributeFilter: ["class", "aria-valuenow"] });
    name();

    // The plot fits its cell, whatever the window and the panels beside it do.
    const live = el.closest(".smcaero-live, .smcaero-study");
    const fit = () => {
      const plot = live.querySelector(".js-plotly-plot");
      if (!plot || !plot._fullLayout) return;
      const width = plot.getBoundingClientRect().width;
      if (!width || Math.abs(plot._fullLayout.width - width) <= 2) return;
      delete plot.layout.width;  // a changed height has fixed it
      window.dispatchEvent(new Event("resize"));
    };
    // What the kernel sent while plotly was loading is lost: say when a plot is there, so that it sends the curves again.
    let seen;
    const drawn = () => {
      const plot = live.querySelector(".js-plotly-plot");
      if (plot && plot._fullLayout && plot !== seen) { seen = plot; fit(); model.send({ drawn: true }); }
    };
    if (live) {
      fitter = new ResizeObserver(fit);
      fitter.observe(live);
      watch = setInterval(drawn, 200);
    }
  };
  start();
  return () => { clearTimeout(timer); clearInterval(watch); observer?.disconnect(); fitter?.disconnect(); };
}
export default { render };
