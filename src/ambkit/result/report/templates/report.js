// Draws a figure when it comes near, and marks in the contents where the reader is.
(() => {
  "use strict";
  // Where nothing can hover, the buttons would lie over the legend for good.
  const buttons = matchMedia("(hover: hover) and (min-width: 45rem)").matches && "hover";
  const config = {
    displayModeBar: buttons,
    displaylogo: false,
    responsive: true,
    showTips: false,
    modeBarButtons: [["toImage"], ["zoom2d", "pan2d"], ["zoomIn2d", "zoomOut2d", "resetScale2d"]],
  };

  const bytes = (base64) => Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));

  async function unpacked(base64) {
    const stream = new Blob([bytes(base64)]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  }

  // The static pictures, for paper, where there are so many that they are packed.
  async function picture(image) {
    const svg = await unpacked(image.dataset.packed);
    image.src = URL.createObjectURL(new Blob([svg], { type: "image/svg+xml" }));
  }

  // plotly.js is unpacked when the first figure asks for it. Browsers that cannot, those before 2023,
  // keep the static pictures.
  let loaded;
  function plotly() {
    loaded ??= unpacked(document.getElementById("plotly.js").textContent).then((text) => {
      const script = document.createElement("script");
      script.textContent = text;
      document.head.append(script);
    });
    return loaded;
  }

  async function draw(box) {
    await plotly();
    const described = await unpacked(box.querySelector("script").textContent);
    const { data, layout } = JSON.parse(described);
    const toImageButtonOptions = { format: "svg", filename: box.dataset.figure };
    Plotly.newPlot(box.querySelector(".chart"), data, layout, { ...config, toImageButtonOptions })
      .then(() => box.classList.add("live"));
  }

  const near = new IntersectionObserver((entries) => {
    for (const { isIntersecting, target } of entries) {
      if (isIntersecting) {
        near.unobserve(target);
        draw(target);
      }
    }
  }, { rootMargin: "800px" });
  if (window.DecompressionStream) {
    document.querySelectorAll("img[data-packed]").forEach(picture);
    document.querySelectorAll(".plot").forEach((box) => near.observe(box));
  }

  const links = new Map();
  document.querySelectorAll("nav a").forEach((link) => links.set(link.hash.slice(1), link));
  const reading = new IntersectionObserver((entries) => {
    for (const { isIntersecting, target } of entries) {
      links.get(target.id)?.toggleAttribute("data-here", isIntersecting);
    }
  }, { rootMargin: "-30% 0px -69% 0px" });
  document.querySelectorAll("main > section").forEach((section) => reading.observe(section));
})();
