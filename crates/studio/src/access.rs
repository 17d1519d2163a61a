//! Who may ask: requests with the session's token, for this host, from this page.

use anyhow::{Context, Result};
use axum::extract::{Request, State};
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, COOKIE, HOST, ORIGIN, REFERRER_POLICY, SET_COOKIE, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

/// Bytes of a token.
const TOKEN_BYTES: usize = 24;
/// Nothing is loaded but from this server, and no script or style that stands in the page itself.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
const PARAMETER: &str = "token=";

/// The secret of a session, and the address for which it holds.
#[derive(Debug, Clone)]
pub struct Access {
    token: String,
    port: u16,
}

impl Access {
    /// A new secret for a server at this port.
    ///
    /// # Errors
    /// The system gives no random numbers.
    pub fn new(port: u16) -> Result<Self> {
        let mut bytes = [0; TOKEN_BYTES];
        getrandom::fill(&mut bytes).context("no random numbers for the token")?;
        Ok(Access { token: bytes.iter().map(|byte| format!("{byte:02x}")).collect(), port })
    }

    /// The link that opens the page.
    pub fn link(&self) -> String {
        format!("http://127.0.0.1:{}/?{PARAMETER}{}", self.port, self.token)
    }

    /// Why a request is refused; none of one that is allowed.
    fn refusal(&self, request: &Request) -> Option<(StatusCode, &'static str)> {
        let headers = request.headers();
        let hosts = [format!("127.0.0.1:{}", self.port), format!("localhost:{}", self.port)];
        let host = text(headers, &HOST).filter(|host| hosts.iter().any(|it| it == host));
        let Some(host) = host else { return Some((StatusCode::MISDIRECTED_REQUEST, "unknown host")) };
        let own = format!("http://{host}");
        let from_here = match text(headers, &ORIGIN) {
            Some(origin) => origin == own,
            None => !headers.contains_key(ORIGIN) && [Method::GET, Method::HEAD].contains(request.method()),
        };
        if !from_here {
            return Some((StatusCode::FORBIDDEN, "the request comes from another page"));
        }
        let has_token = self.in_cookie(headers) || self.in_link(request);
        (!has_token).then_some((StatusCode::UNAUTHORIZED, "open the link that `paig studio` printed"))
    }

    /// A cookie is sent to all ports of a host, so its name holds the port.
    fn cookie_name(&self) -> String {
        format!("paig_studio_{}", self.port)
    }

    fn in_cookie(&self, headers: &HeaderMap) -> bool {
        let name = self.cookie_name();
        let pairs = headers.get_all(COOKIE).iter().filter_map(|value| value.to_str().ok());
        let mut pairs = pairs.flat_map(|value| value.split(';')).filter_map(|pair| pair.trim().split_once('='));
        pairs.any(|(key, value)| key == name && self.is_token(value))
    }

    /// Only the page itself takes the token from its address.
    fn in_link(&self, request: &Request) -> bool {
        let mut pairs = request.uri().query().unwrap_or_default().split('&');
        request.uri().path() == "/"
            && pairs.any(|pair| pair.strip_prefix(PARAMETER).is_some_and(|value| self.is_token(value)))
    }

    /// Takes as long for every wrong token.
    fn is_token(&self, other: &str) -> bool {
        let differing = self.token.bytes().zip(other.bytes()).fold(0, |differing, (a, b)| differing | (a ^ b));
        other.len() == self.token.len() && differing == 0
    }
}

fn text<'a>(headers: &'a HeaderMap, name: &HeaderName) -> Option<&'a str> {
    headers.get(name).and_then(|value| value.to_str().ok())
}

/// Lets requests through that are allowed, and sets the headers of every answer.
pub async fn guard(State(access): State<Access>, request: Request, next: Next) -> Response {
    let opens = access.in_link(&request);
    let mut response = match access.refusal(&request) {
        Some(refusal) => refusal.into_response(),
        None => next.run(request).await,
    };
    let headers = response.headers_mut();
    headers.entry(CONTENT_SECURITY_POLICY).or_insert(HeaderValue::from_static(POLICY));
    headers.insert(X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.insert(HeaderName::from_static("cross-origin-resource-policy"), HeaderValue::from_static("same-origin"));
    headers.entry(CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    if opens && response.status().is_success() {
        let cookie = format!("{}={}; Path=/; HttpOnly; SameSite=Strict", access.cookie_name(), access.token);
        if let Ok(cookie) = HeaderValue::from_str(&cookie) {
            response.headers_mut().insert(SET_COOKIE, cookie);
        }
    }
    response
}

#[cfg(test)]
mod tests {
    use axum::body::Body;

    use super::*;

    fn status(method: &str, path: &str, headers: &[(HeaderName, &str)]) -> u16 {
        let access = Access { token: "abcd".into(), port: 8000 };
        let mut request = Request::builder().method(method).uri(path);
        for (name, value) in headers {
            request = request.header(name, *value);
        }
        access.refusal(&request.body(Body::empty()).unwrap()).map_or(200, |(status, _)| status.as_u16())
    }

    #[test]
    fn only_requests_of_the_page_with_the_token_are_allowed() {
        let (host, cookie) = ("127.0.0.1:8000", "x=1; paig_studio_8000=abcd");
        let get = |headers: &[(HeaderName, &str)]| status("GET", "/api/projects", headers);
        assert_eq!(get(&[(HOST, host), (COOKIE, cookie)]), 200);
        assert_eq!(get(&[(HOST, "localhost:8000"), (COOKIE, cookie)]), 200);
        for wrong in ["evil.example:8000", "127.0.0.1:8001", "127.0.0.1"] {
            assert_eq!(get(&[(HOST, wrong), (COOKIE, cookie)]), 421);
        }
        assert_eq!(get(&[(COOKIE, cookie)]), 421);
        for wrong in ["paig_studio_8000=abce", "paig_studio_8000=abcde", "paig_studio_8000=", "paig_studio_8001=abcd"] {
            assert_eq!(get(&[(HOST, host), (COOKIE, wrong)]), 401);
        }
        assert_eq!(get(&[(HOST, host)]), 401);
        for (origin, expected) in [("http://127.0.0.1:8000", 200), ("http://evil.example", 403), ("null", 403)] {
            for method in ["GET", "POST", "PUT", "DELETE"] {
                let headers = [(HOST, host), (COOKIE, cookie), (ORIGIN, origin)];
                assert_eq!(status(method, "/api/projects", &headers), expected, "{method} {origin}");
            }
        }
        assert_eq!(status("POST", "/api/projects", &[(HOST, host), (COOKIE, cookie)]), 403);
    }

    #[test]
    fn the_link_opens_the_page_alone() {
        let host = [(HOST, "127.0.0.1:8000")];
        assert_eq!(status("GET", "/?token=abcd", &host), 200);
        assert_eq!(status("GET", "/?token=abc", &host), 401);
        assert_eq!(status("GET", "/api/projects?token=abcd", &host), 401);
    }
}
