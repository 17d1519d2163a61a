//! report.html: report.md rendered, the pictures within it.

use std::path::Path;

use anyhow::{Context, Result};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use pulldown_cmark::{CowStr, Event, Options, Parser, Tag};

use paig::support::storage;

const HEAD: &str = "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
    <meta name=\"viewport\" content=\"width=device-width\">\n<title>";
const STYLE: &str = include_str!("style.css");

/// Renders a page; its PNG pictures are read from `folder` and stand within it, others beside it.
pub fn render(title: &str, markdown: &str, folder: &Path) -> Result<String> {
    let events = Parser::new_ext(markdown, Options::ENABLE_TABLES).map(|event| match event {
        Event::Start(Tag::Image { link_type, dest_url, title, id }) if dest_url.ends_with(".png") => {
            let dest_url = CowStr::from(inline(&folder.join(&*dest_url))?);
            Ok(Event::Start(Tag::Image { link_type, dest_url, title, id }))
        }
        // The report holds no HTML of its own; what looks like it came from a file's name.
        Event::Html(text) | Event::InlineHtml(text) => Ok(Event::Text(text)),
        event => Ok(event),
    });
    let events: Vec<Event> = events.collect::<Result<_>>()?;
    let mut page = format!("{HEAD}{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n");
    pulldown_cmark::html::push_html(&mut page, events.into_iter());
    page.push_str("</body>\n</html>\n");
    Ok(page)
}

/// A PNG as a data address.
fn inline(path: &Path) -> Result<String> {
    let bytes = storage::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(bytes)))
}
