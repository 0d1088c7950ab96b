// A field's name belongs to what has the keyboard's focus; Quasar leaves that of a select at its frame.
new MutationObserver(() => {
  for (const frame of document.querySelectorAll("label.q-field[aria-label]")) {
    const field = frame.querySelector("input");
    if (!field) continue;
    field.setAttribute("aria-label", frame.getAttribute("aria-label"));
    frame.removeAttribute("aria-label");
  }
}).observe(document.documentElement, {childList: true, subtree: true});
