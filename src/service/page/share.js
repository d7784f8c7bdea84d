// A link that contains the whole specification: its text, deflated (RFC 1951) and encoded as base64url (RFC 4648,
// section 5), stands after `#s=`. The part of a URL after `#` is never sent to a server, and it contains no token.

const LONGEST = 4 << 20; // largest size in bytes of the inflated text of a link
const SMALL = 16 << 10; // size in bytes up to which a text from a link is solved at once

export async function packed(text) {
  const deflated = new Blob([text]).stream().pipeThrough(new CompressionStream("deflate-raw"));
  const bytes = new Uint8Array(await new Response(deflated).arrayBuffer());
  let binary = "";
  for (const byte of bytes) binary += String.fromCharCode(byte);
  return btoa(binary).replaceAll("+", "-").replaceAll("/", "_").replace(/=+$/, "");
}

// Returns the text that was packed into a link; throws if it is damaged or far too long.
export async function unpacked(letters) {
  const bytes = Uint8Array.from(atob(letters.replaceAll("-", "+").replaceAll("_", "/")), (letter) => letter.charCodeAt(0));
  const reader = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw")).getReader();
  const decoder = new TextDecoder("utf-8", { fatal: true });
  let [text, length] = ["", 0];
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return text + decoder.decode();
    length += value.length;
    if (length > LONGEST) {
      reader.cancel();
      throw new RangeError("the link would be longer than 4 MiB");
    }
    text += decoder.decode(value, { stream: true });
  }
}

// Whether a text from a link may be solved before the user has looked at it: it is short, and asks for one run.
export function isSmall(text) {
  if (text.length > SMALL) return false;
  try {
    const { study, sweep, fit } = JSON.parse(text);
    return !study && !sweep && !fit;
  } catch {
    return false;
  }
}
