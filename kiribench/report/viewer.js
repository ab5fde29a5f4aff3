"use strict";
(() => {
  const button = document.getElementById("view-load");
  const status = document.getElementById("view-status");
  const stage = document.getElementById("knee-3d");
  const inflate = async (id) => {
    const words = document.getElementById(id).textContent;
    const bytes = Uint8Array.from(atob(words), (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  };
  const show = async () => {
    button.disabled = true;
    status.textContent = "Loading …";
    try {
      const script = document.createElement("script");
      script.textContent = await inflate("view-library");
      document.head.append(script);
      const spec = JSON.parse(await inflate("view-data"));
      stage.hidden = false;
      await window.Plotly.newPlot(stage, spec.data, spec.layout, spec.config);
      status.textContent = "Drag to turn, scroll or pinch to zoom, click a name below to hide it.";
      button.hidden = true;
      stage.dataset.ready = "yes";
    } catch (error) {
      stage.hidden = true;
      button.disabled = false;
      status.textContent = "This browser cannot show the 3-D view (" + error.message + ").";
    }
  };
  status.textContent = "";
  button.hidden = false;
  button.addEventListener("click", show);
})();
