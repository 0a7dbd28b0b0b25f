/* Search results: snippets of the text of a page, not of its title for printing, its contents and its buttons. */
"use strict";

{
  const NO_TEXT = "#jb-print-docs-body, .bd-header-article, .headerlink, .himap-links, .himap-cite, nav";
  const whole = Search.htmlToText;
  Search.htmlToText = (page, anchor) => {
    const read = new DOMParser().parseFromString(page, "text/html");
    read.querySelectorAll(NO_TEXT).forEach((one) => one.remove());
    read.querySelectorAll("td, th, dt, dd, li").forEach((one) => one.append(" "));
    return whole(read.documentElement.outerHTML, anchor).replace(/\\[()]/g, "").replace(/\s+/g, " ");
  };
}
