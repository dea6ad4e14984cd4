// Light or dark: the system's choice until the button is pressed; stored for this page's address.

const KEY = "tactophone-theme";
const system = matchMedia("(prefers-color-scheme: dark)");

function current() {
  return localStorage.getItem(KEY) ?? (system.matches ? "dark" : "light");
}

function apply() {
  document.documentElement.dataset.theme = current();
  const button = document.querySelector("#theme");
  if (button) button.textContent = current() === "dark" ? "Light" : "Dark";
  dispatchEvent(new Event("themechange"));
}

system.addEventListener("change", apply);
document.querySelector("#theme")?.addEventListener("click", () => {
  localStorage.setItem(KEY, current() === "dark" ? "light" : "dark");
  apply();
});
apply();
