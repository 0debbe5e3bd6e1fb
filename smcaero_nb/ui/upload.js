// A button that reads a file and sends it in pieces: servers drop messages above 10 MB without a word.
const PIECE = 1 << 20;

function render({ model, el }) {
  const button = document.createElement("button"), input = document.createElement("input"), words = document.createElement("span");
  button.className = "jupyter-button smcaero-file";
  button.innerHTML = '<i class="fa fa-upload"></i> ';
  words.textContent = "Your own file";
  button.title = "A text file of numbers, with a line of names";
  button.appendChild(words);
  Object.assign(input, { type: "file", accept: ".csv,.txt,.tsv,.dat", hidden: true });
  el.append(button, input);
  button.addEventListener("click", () => input.click());
  input.addEventListener("change", async () => {
    const [file] = input.files;
    if (!file) return;
    const content = await file.arrayBuffer();
    for (let at = 0; at === 0 || at < content.byteLength; at += PIECE)
      model.send({ name: file.name, first: at === 0, last: at + PIECE >= content.byteLength }, undefined, [content.slice(at, at + PIECE)]);
    input.value = "";  // so that the same file can be given again
  });
}
export default { render };
