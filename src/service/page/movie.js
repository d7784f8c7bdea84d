// The moving picture of an answer as a WebM file: it is played once from start to end, at the chosen speed, and
// recorded as it is drawn.

const RATE = 30; // frames per second
const BITS = 4e6; // bits per second

export const canRecord = () => typeof MediaRecorder === "function" && MediaRecorder.isTypeSupported("video/webm");

// Records what `canvas` shows while `clock` plays its time horizon. The canvas is transparent on the page, and gets
// the colour `background` in the film.
export async function record(canvas, clock, background) {
  const film = document.createElement("canvas");
  [film.width, film.height] = [canvas.width, canvas.height];
  const context = film.getContext("2d");
  const copy = () => {
    context.fillStyle = background;
    context.fillRect(0, 0, film.width, film.height);
    context.drawImage(canvas, 0, 0, film.width, film.height);
  };
  const recorder = new MediaRecorder(film.captureStream(RATE), { mimeType: "video/webm", videoBitsPerSecond: BITS });
  const chunks = [];
  recorder.addEventListener("dataavailable", ({ data }) => chunks.push(data));
  const stopped = new Promise((resolve) => recorder.addEventListener("stop", resolve));
  const leave = clock.listen(copy);
  try {
    recorder.start();
    await clock.playThrough();
  } finally {
    leave();
    recorder.stop();
  }
  await stopped;
  return new Blob(chunks, { type: "video/webm" });
}
