"use strict";
(() => {
  const frame = document.querySelector(".replay");
  const [button, canvas, said] = ["button", "canvas", "output"].map((name) => frame.querySelector(name));

  async function unpacked(id) {
    const element = document.getElementById(id);
    const text = atob(element.textContent);
    element.remove();
    const bytes = Uint8Array.from(text, (character) => character.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  async function start() {
    button.disabled = true;
    said.textContent = "starting ...";
    try {
      const module = await unpacked("rerun-module");
      await wasm_bindgen({ module_or_path: module });
      canvas.hidden = false;
      const handle = new wasm_bindgen.WebHandle({
        hide_welcome_screen: true,
        enable_history: false,
        persist: false,
        notebook: true,
        theme: "dark",
      });
      await handle.start(canvas);
      handle.open_channel("log", "log");
      handle.send_rrd_to_channel("log", await unpacked("rerun-recording"));
      button.parentElement.hidden = true;
    } catch (error) {
      said.textContent = `The viewer does not start in this browser: ${error}`;
    }
  }

  button.addEventListener("click", start);
  if (location.hash === "#viewer") start();
})();
