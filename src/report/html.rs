//! report.html: report.md rendered, the pictures within it.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use pulldown_cmark::{CowStr, Event, Options, Parser, Tag};

const HEAD: &str = "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
    <meta name=\"viewport\" content=\"width=device-width\">\n\
    <title>Physics-as-Inverse-Graphics: report of runs</title>\n<style>\n";
const STYLE: &str = include_str!("style.css");

/// Renders the report; its pictures are read from `folder`.
pub(super) fn render(markdown: &str, folder: &Path) -> Result<String> {
    let events = Parser::new_ext(markdown, Options::ENABLE_TABLES).map(|event| match event {
        Event::Start(Tag::Image { link_type, dest_url, title, id }) => {
            let dest_url = CowStr::from(inline(&folder.join(&*dest_url))?);
            Ok(Event::Start(Tag::Image { link_type, dest_url, title, id }))
        }
        // The report holds no HTML of its own; what looks like it came from a file's name.
        Event::Html(text) | Event::InlineHtml(text) => Ok(Event::Text(text)),
        event => Ok(event),
    });
    let events: Vec<Event> = events.collect::<Result<_>>()?;
    let mut page = format!("{HEAD}{STYLE}</style>\n</head>\n<body>\n");
    pulldown_cmark::html::push_html(&mut page, events.into_iter());
    page.push_str("</body>\n</html>\n");
    Ok(page)
}

/// A picture as a data address.
fn inline(path: &Path) -> Result<String> {
    let kind = match path.extension().and_then(|extension| extension.to_str()) {
        Some("png") => "image/png",
        Some("gif") => "image/gif",
        _ => bail!("{}: neither PNG nor GIF", path.display()),
    };
    let bytes = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    Ok(format!("data:{kind};base64,{}", STANDARD.encode(bytes)))
}
