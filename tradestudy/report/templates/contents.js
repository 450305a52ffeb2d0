// The table of contents follows the reader.
const links = new Map($$("nav a").map((link) => [link.getAttribute("href").slice(1), link]));
const headings = $$("main [id]").filter((one) => /^H[2-5]$/.test(one.tagName) && links.has(one.id));
let asked = false;
const follow = () => {
  asked = false;
  const passed = headings.filter((one) => one.getBoundingClientRect().top < innerHeight * 0.3);
  const current = (passed.at(-1) ?? headings[0])?.id;
  for (const [id, link] of links) {
    if (id !== current) link.removeAttribute("aria-current");
    else if (!link.hasAttribute("aria-current")) {
      link.setAttribute("aria-current", "location");
      const nav = link.closest("nav"), [box, own] = [nav.getBoundingClientRect(), link.getBoundingClientRect()];
      if (own.top < box.top || own.bottom > box.bottom) nav.scrollTop += own.top - box.top - nav.clientHeight / 2;
    }
  }
};
addEventListener("scroll", () => {
  if (!asked) requestAnimationFrame(follow);
  asked = true;
}, { passive: true });
follow();
