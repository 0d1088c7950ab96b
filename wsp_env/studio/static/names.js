// A field's name belongs to what has the keyboard's focus; Quasar leaves that of a select at its frame or at the text in it.
// It is kept at the frame, since Quasar may make the field anew.
new MutationObserver(() => {
  for (const named of document.querySelectorAll("label.q-field[aria-label], label.q-field .q-field__native[aria-label]:not(input)")) {
    named.closest("label.q-field").dataset.name = named.getAttribute("aria-label");
    named.removeAttribute("aria-label");
  }
  for (const frame of document.querySelectorAll("label.q-field[data-name]")) {
    const field = frame.querySelector("input");
    if (field && field.getAttribute("aria-label") !== frame.dataset.name) field.setAttribute("aria-label", frame.dataset.name);
  }
}).observe(document.documentElement, {childList: true, subtree: true, attributeFilter: ["aria-label"]});
