// A reader of server-sent events (WHATWG HTML, section 9.2) from a response. The browser's own reader, `EventSource`,
// cannot send a token.

export async function* events(response) {
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let text = "";
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      const blocks = (text + value).split("\n\n");
      text = blocks.pop();
      yield* blocks.map(eventOf).filter((event) => event.data !== undefined);
    }
  } finally {
    reader.cancel().catch(() => {}); // a stream that broke off has nothing to cancel
  }
}

// Parses a server-sent event. Lines without a name are comments, which keep the connection alive.
function eventOf(block) {
  const lines = block.split("\n").map((line) => [line.slice(0, line.indexOf(":")), line.slice(line.indexOf(":") + 2)]);
  return Object.fromEntries(lines.filter(([name]) => name !== ""));
}
