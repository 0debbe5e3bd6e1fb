// A button: the kernel sends the text when it is pressed, and the browser saves it.
async function render({ model, el }) {
  const saved = await model.widget_manager.get_model(model.get("saved").slice("IPY_MODEL_".length));
  const button = document.createElement("button");
  button.className = "jupyter-button smcaero-download";
  button.innerHTML = '<i class="fa fa-download"></i> ';
  const words = document.createElement("span");
  button.appendChild(words);
  el.appendChild(button);
  const name = () => { words.textContent = `Download ${saved.get("file")}`; button.style.display = saved.get("file") ? "" : "none"; };
  const save = (_, buffers) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([buffers[0]], { type: "text/csv" }));
    link.download = saved.get("file");
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000);
  };
  button.addEventListener("click", () => saved.send({}));
  saved.on("change:file", name);
  saved.on("msg:custom", save);
  name();
  return () => { saved.off("change:file", name); saved.off("msg:custom", save); };
}
export default { render };
