// A button: the kernel sends the text when it is pressed, and the browser saves it.
function render({ model, el }) {
  const button = document.createElement("button");
  button.className = "jupyter-button smcaero-download";
  button.innerHTML = '<i class="fa fa-download"></i> ';
  const words = document.createElement("span");
  button.appendChild(words);
  el.appendChild(button);
  const name = () => { words.textContent = `Download ${model.get("file")}`; button.style.display = model.get("file") ? "" : "none"; };
  const save = (_, buffers) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([buffers[0]], { type: "text/csv" }));
    link.download = model.get("file");
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000);
  };
  button.addEventListener("click", () => model.send({}));
  model.on("change:file", name);
  model.on("msg:custom", save);
  name();
  return () => { model.off("change:file", name); model.off("msg:custom", save); };
}
export default { render };
