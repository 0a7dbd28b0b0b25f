/* The text of one page for the PDF: names and links unique in the whole, without what only a screen can use. */
(pages) => {
  const name = (address) => address.split("/").slice(-2).join("-").replace(".html", "");
  const here = location.href.split("#")[0];
  const article = document.querySelector("article.bd-article");
  const all = (query) => [...article.querySelectorAll(query)];
  const galleries = [...new Set(all(".himap-chapter").map((one) => one.closest("section")))];
  all(".headerlink, button, script, .himap-chapter, .himap-cite, .copybtn").forEach((one) => one.remove());
  // A section of nothing else: its heading, and the targets of links to it.
  galleries.filter((one) => [...one.children].every((part) => part.matches("h2, span"))).forEach((one) => one.remove());
  all(".himap-links").forEach((one) => one.replaceChildren(...one.querySelectorAll("code")));
  all("details:not(.hide)").forEach((one) => one.open = true);
  all("details.hide").forEach((one) => one.remove());
  all("img").forEach((one) => { one.src = one.src; one.removeAttribute("loading"); });
  all("a[href]").forEach((one) => {
    const [address, anchor] = one.href.split("#");
    if (!address.startsWith(location.origin)) return;
    if (pages.includes(address)) one.setAttribute("href", "#" + name(address) + (anchor ? "--" + anchor : ""));
    else one.replaceWith(...one.childNodes);
  });
  all("[id]").forEach((one) => one.id = name(here) + "--" + one.id);
  article.id = name(here);
  return {id: article.id, title: article.querySelector("h1").textContent, text: article.outerHTML};
}
