// The WebSocket to the viewer's server.
//
// From the server, JSON with `type`:
//   hello   kind (live | replay), name, rig {mode, length_m, ...}; of a replay also begin, end, marks
//           (s, where reaches begin) and damage (lines about the log)
//   states  states (oldest first), nodes, lost (messages the viewer did not get), skipped (pictures
//           this page was too slow for); of a replay also reset (states replace the past), playhead,
//           playing, speed
// To the server, JSON with `do`: target {x, y} in m; play; pause; speed {value}; seek {t} in s.
export function connect(onMessage, onClose) {
  const socket = new WebSocket(`ws://${location.host}/ws`);
  socket.addEventListener("message", (event) => onMessage(JSON.parse(event.data)));
  socket.addEventListener("close", onClose);
  return (command) => {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(command));
  };
}
