"use strict";
// tables: a click on a title sorts; what is not known comes last
const words = new Intl.Collator(undefined, { numeric: true });
document.querySelectorAll("table.sortable").forEach(table => {
  const body = table.tBodies[0], rows = [...body.rows], headers = [...table.tHead.rows[0].cells];
  const compare = { number: (a, b) => a - b, text: words.compare };
  headers.forEach(header => header.firstElementChild.addEventListener("click", () => {
    const sign = header.ariaSort === "ascending" ? -1 : 1, by = compare[header.dataset.by];
    headers.forEach(one => one.removeAttribute("aria-sort"));
    header.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
    const keyed = rows.map((row, i) => [row.cells[header.cellIndex].dataset.value, i, row]);
    keyed.sort(([a, i], [b, j]) => (a === "") - (b === "") || (a === "" ? 0 : sign * by(a, b)) || i - j);
    body.append(...keyed.map(([, , row]) => row));
  }));
});

// the two images in turn, or mixed
const flicker = document.querySelector("#flicker");
if (flicker) {
  const over = flicker.querySelector(".over"), range = flicker.querySelector("input");
  const button = flicker.querySelector("button");
  let timer = 0;
  const stop = () => { clearInterval(timer); timer = 0; button.textContent = "Flicker"; };
  range.addEventListener("input", () => { stop(); over.style.opacity = range.value / 100; });
  button.addEventListener("click", () => {
    if (timer) return stop();
    button.textContent = "Stop";
    timer = setInterval(() => { range.value = range.value > 50 ? 0 : 100; over.style.opacity = range.value / 100; }, 600);
  });
}

// the model: unpacked into a frame of its own when it comes into view
const model = document.querySelector("#model");
if (model) {
  const place = model.querySelector(".model");
  const show = async () => {
    const packed = Uint8Array.from(atob(model.querySelector(".packed").textContent), one => one.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    const frame = document.createElement("iframe");
    frame.title = "model";
    frame.srcdoc = await new Response(stream).text();
    place.replaceChildren(frame);
  };
  const seen = new IntersectionObserver(entries => {
    if (!entries.some(one => one.isIntersecting)) return;
    seen.disconnect();
    show().catch(error => { place.firstElementChild.textContent = `This browser cannot show the model (${error.message}).`; });
  }, { rootMargin: "200px" });
  seen.observe(place);
}
