// Helpers for the page's elements.
export const $ = id => document.getElementById(id);

export function text(node, words) {
  const told = String(words ?? "");
  if (node.textContent !== told) node.textContent = told;
}

// attributes that are null are left out
export function make(name, attributes = {}, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) if (value !== null) node.setAttribute(key, value);
  node.append(...children);
  return node;
}
