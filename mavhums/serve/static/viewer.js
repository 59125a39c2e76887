// The 3-D viewer asks without cookies; the recording is only for the session that has one.
"use strict";

const ask = window.fetch.bind(window);
window.fetch = (what, how) => {
  const request = new Request(what, how);
  const own = new URL(request.url).origin === location.origin;
  return ask(own ? new Request(request, { credentials: "same-origin" }) : request);
};
