// keeps the vertical of the model upright while it is turned, shows its picture as light as it is, and has the page's colour
(function upright() {
  if (!window.controls) return requestAnimationFrame(upright);
  const update = controls.update;
  controls.update = function () {
    camera.up.set(0, 1, 0);
    update.call(controls);
    camera.up.set(0, 1, 0);
    camera.lookAt(controls.target);
  };
  if ("outputColorSpace" in renderer) renderer.outputColorSpace = THREE.SRGBColorSpace;
  else renderer.outputEncoding = THREE.sRGBEncoding;
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const paint = () => { scene.background.set(dark.matches ? 0x212429 : 0xf3f4f6); render(); };
  dark.addEventListener("change", paint);
  paint();
})();
