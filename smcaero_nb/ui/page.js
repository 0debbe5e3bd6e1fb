// What ipywidgets leave out in the page: accessible names and states of sliders, entries, groups that open, messages.
async function render({ model, el }) {
  const told = await model.widget_manager.get_model(model.get("told").slice("IPY_MODEL_".length));
  el.style.display = "none";
  let observer, timer;

  const start = () => {
    const mask = el.closest(".smcaero-mask, .smcaero-study");
    if (!mask) { timer = setTimeout(start, 50); return; }

    const name = () => {
      for (const [key, [text, log]] of Object.entries(told.get("names"))) {
        const row = mask.querySelector(`.smcaero-set-${CSS.escape(key)}`);
        if (!row) continue;
        row.querySelectorAll("[role=slider], input, select").forEach(e => e.setAttribute("aria-label", text));
        if (log) row.querySelectorAll("[role=slider]").forEach(e =>
          e.setAttribute("aria-valuetext", String(Number((10 ** e.getAttribute("aria-valuenow")).toPrecision(3)))));
        row.querySelectorAll("input[type=text]").forEach(e => e.setAttribute("aria-invalid", row.classList.contains("smcaero-refused")));
      }
      // keys meant for a control are not commands of the notebook
      mask.querySelectorAll("select, button, input, [role=slider]").forEach(e => e.setAttribute("data-lm-suppress-shortcuts", "true"));
      mask.querySelectorAll(".smcaero-fold, .smcaero-help").forEach(e => e.setAttribute("aria-expanded", e.classList.contains("mod-active")));
      mask.querySelectorAll(".smcaero-choice select").forEach(e => e.setAttribute("aria-label", "closed loop"));
      mask.querySelectorAll(".smcaero-doc, .smcaero-doc mjx-container[display=true]").forEach(e => e.setAttribute("tabindex", "0"));
      mask.querySelectorAll(".smcaero-status").forEach(e => { e.setAttribute("role", "status"); e.setAttribute("aria-live", "polite"); });
      mask.querySelectorAll(".widget-play button").forEach((e, i) => e.setAttribute("aria-label", ["play or pause", "stop", "repeat"][i]));
      mask.querySelectorAll(".smcaero-busy [role=progressbar], .smcaero-busy .progress").forEach(e => e.setAttribute("aria-label", "progress of the run"));
    };
    let asked = false;
    const later = () => { if (!asked) { asked = true; requestAnimationFrame(() => { asked = false; name(); }); } };
    observer = new MutationObserver(later);
    observer.observe(mask, { childList: true, subtree: true, attributes: true, attributeFilter: ["class", "aria-valuenow"] });
    name();
  };
  start();
  return () => { clearTimeout(timer); observer?.disconnect(); };
}
export default { render };
