/* Every page: a click on a figure shows it large, a citation gets the address of its page, names of the rows
   of a table do not break, paper is white and shows the answers to exercises. */
"use strict";

(() => {
  const large = document.createElement("dialog");
  large.className = "himap-large";
  large.innerHTML = '<form method="dialog"><button aria-label="Close">Close ✕</button></form>';
  const picture = document.createElement("img");
  large.addEventListener("click", (event) => event.target !== large && event.target !== picture || large.close());
  document.body.append(large);

  function enlarge(image) {
    picture.src = image.src;
    picture.alt = image.alt;
    large.setAttribute("aria-label", image.alt);
    large.append(picture);
    large.showModal();
  }

  for (const image of document.querySelectorAll("article figure img, .cell_output a.image-reference img")) {
    const link = image.closest("a");
    if (link) {
      link.addEventListener("click", (event) => {
        if (event.ctrlKey || event.metaKey || event.shiftKey) return;
        event.preventDefault();
        enlarge(image);
      });
      continue;
    }
    const button = document.createElement("button");
    button.type = "button";
    button.className = "himap-enlarge";
    button.setAttribute("aria-label", `Enlarge: ${image.alt}`);
    button.title = "Enlarge";
    button.addEventListener("click", () => enlarge(image));
    image.replaceWith(button);
    button.append(image);
  }

  const LONGEST_NAME = 36;  // letters: the longest that leave room to three more columns of the text's width
  for (const table of document.querySelectorAll(".bd-article table.table:has(th:nth-child(4))")) {
    const names = [...table.querySelectorAll("td:first-child")];
    table.classList.toggle("himap-names", names.every((name) => name.textContent.trim().length <= LONGEST_NAME));
  }

  if (location.protocol.startsWith("http")) {
    for (const citation of document.querySelectorAll(".himap-citation")) {
      citation.textContent += ` ${location.href.split("#")[0]}#${citation.dataset.anchor}`;
    }
  }

  for (const citation of document.querySelectorAll(".himap-citation")) {
    if (!navigator.clipboard) break;
    const copy = document.createElement("button");
    copy.type = "button";
    copy.textContent = "Copy";
    copy.addEventListener("click", async () => {
      await navigator.clipboard.writeText(citation.textContent);
      copy.textContent = "Copied";
    });
    citation.after(" ", copy);
  }

  let theme = null;
  let folded = [];
  addEventListener("beforeprint", () => {
    theme = document.documentElement.dataset.theme;
    document.documentElement.dataset.theme = "light";
    folded = [...document.querySelectorAll("details.himap-answer:not([open])")];
    for (const answer of folded) answer.open = true;
  });
  addEventListener("afterprint", () => {
    document.documentElement.dataset.theme = theme;
    for (const answer of folded) answer.open = false;
  });
})();
