// keeps the vertical of the model upright while it is turned, and gives it the colour of the page
(function upright() {
  if (!window.controls) return requestAnimationFrame(upright);
  const update = controls.update;
  controls.update = function () {
    camera.up.set(0, 1, 0);
    update.call(controls);
    camera.up.set(0, 1, 0);
    camera.lookAt(controls.target);
  };
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const paint = () => { scene.background.set(dark.matches ? 0x212429 : 0xf3f4f6); render(); };
  dark.addEventListener("change", paint);
  paint();
})();
