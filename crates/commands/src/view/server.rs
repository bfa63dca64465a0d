//! Serves the page: on the loopback interface alone, under an address with a secret, to browsers that ask for this host.

use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::{Query, Request, State};
use axum::http::{HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use serde::{Deserialize, Serialize};
use tactile_pose_fusion::leave;
use tactile_pose_fusion::observer::Observer;

use super::assets::ASSETS;
use super::error::ViewError;
use super::session::BagView;

/// How often it is looked whether the process should end.
const LOOK: Duration = Duration::from_millis(50);

/// Points of a trace that a page may ask for.
const POINTS: std::ops::RangeInclusive<usize> = 10..=20_000;

/// Limits of a page: it may run its own scripts, and talk to this server. It loads nothing from elsewhere, and no other
/// page can hold it. Libraries set styles of elements by script, which needs no leave.
const HEADERS: [(HeaderName, &str); 5] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-store"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

/// The bag or the node that is shown.
#[derive(Debug, Clone)]
pub enum Content {
    /// A bag.
    Session(Arc<BagView>),
    /// A running node.
    #[cfg(feature = "ros")]
    Live(super::feed::Feed),
}

/// A place at which a page can be served.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    secret: String,
}

/// State from which requests are answered.
#[derive(Clone)]
struct Answering {
    /// The names under which this server may be asked: any other name is of a page elsewhere, whose name was made to lead
    /// here (DNS rebinding).
    hosts: [String; 2],
    content: Content,
}

impl Server {
    /// Takes a port of 127.0.0.1: this one, or any.
    ///
    /// # Errors
    /// [`ViewError`] if the port can't be used.
    pub fn bind(port: Option<u16>) -> Result<Self, ViewError> {
        let at = SocketAddr::from((Ipv4Addr::LOCALHOST, port.unwrap_or(0)));
        let listener = TcpListener::bind(at).map_err(|error| match port {
            Some(port) => ViewError::Port { port, error },
            None => ViewError::Serve(error),
        })?;
        listener.set_nonblocking(true).map_err(ViewError::Serve)?;
        let address = listener.local_addr().map_err(ViewError::Serve)?;
        let mut secret = [0; 16];
        getrandom::fill(&mut secret).map_err(|error| ViewError::Serve(std::io::Error::other(error)))?;
        Ok(Server { listener, address, secret: secret.iter().map(|byte| format!("{byte:02x}")).collect() })
    }

    /// The address of the page.
    pub fn url(&self) -> String {
        format!("http://{}/{}/", self.address, self.secret)
    }

    /// Tells who may see the page and for how long, and opens it in the browser of the desktop if that is asked for.
    pub fn tell(&self, opens: bool, observer: &dyn Observer) {
        observer.note("the page is served to this computer alone, until Ctrl-C");
        if opens && let Err(error) = open::that_detached(self.url()) {
            observer.warn(&format!("no browser could be opened ({error}); open the address above in one"));
        }
    }

    /// Serves the page until the process is asked to end.
    ///
    /// # Errors
    /// [`ViewError`] if it can't be served.
    pub fn serve(self, content: Content) -> Result<(), ViewError> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(ViewError::Serve)?;
        let router = self.router(content);
        runtime.block_on(async {
            let listener = tokio::net::TcpListener::from_std(self.listener).map_err(ViewError::Serve)?;
            tokio::select! {
                served = async { axum::serve(listener, router).await } => served.map_err(ViewError::Serve),
                () = until_asked() => Ok(()),
            }
        })
    }

    fn router(&self, content: Content) -> Router {
        let below = |name: &str| format!("/{}/{name}", self.secret);
        let port = self.address.port();
        let answering = Answering { hosts: ["127.0.0.1", "localhost"].map(|name| format!("{name}:{port}")), content };
        let mut router = Router::new()
            .route(&below("setup"), get(setup))
            .route(&below("traces"), get(traces))
            .route(&below("frame"), get(frame));
        #[cfg(feature = "ros")]
        {
            router = router.route(&below("updates"), get(updates));
        }
        for asset in ASSETS {
            let answer = move || async move { ([(header::CONTENT_TYPE, asset.media_type)], asset.text) };
            router = router.route(&below(asset.name), get(answer));
        }
        let check = middleware::from_fn_with_state(answering.clone(), checked);
        router.fallback(|| async { StatusCode::NOT_FOUND }).layer(check).with_state(answering)
    }
}

async fn until_asked() {
    let mut looks = tokio::time::interval(LOOK);
    while !leave::asked() {
        looks.tick().await;
    }
}

/// Answers only who asks for this host, and says what the page may do.
async fn checked(State(answering): State<Answering>, request: Request, next: Next) -> Response {
    let host = request.headers().get(header::HOST).and_then(|host| host.to_str().ok());
    let is_ours = host.is_some_and(|host| answering.hosts.iter().any(|ours| ours == host));
    let mut response = match is_ours {
        true => next.run(request).await,
        false => (StatusCode::MISDIRECTED_REQUEST, "this server is asked as 127.0.0.1").into_response(),
    };
    for (name, value) in HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

/// A window of time and how finely it is to be drawn.
#[derive(Debug, Clone, Copy, Deserialize)]
struct Window {
    /// s.
    from: f64,
    /// s.
    to: f64,
    points: usize,
}

/// A moment, s.
#[derive(Debug, Clone, Copy, Deserialize)]
struct Moment {
    t: f64,
}

async fn setup(State(answering): State<Answering>) -> Response {
    match &answering.content {
        Content::Session(session) => axum::Json(session.setup()).into_response(),
        #[cfg(feature = "ros")]
        Content::Live(feed) => axum::Json(feed.setup()).into_response(),
    }
}

async fn traces(State(answering): State<Answering>, Query(window): Query<Window>) -> Response {
    let Window { from, to, points } = window;
    if !(from.is_finite() && to.is_finite() && from <= to && POINTS.contains(&points)) {
        let expected = format!("expected from <= to and points {} to {}", POINTS.start(), POINTS.end());
        return (StatusCode::BAD_REQUEST, expected).into_response();
    }
    from_session(answering, move |session| session.traces(from, to, points)).await
}

async fn frame(State(answering): State<Answering>, Query(Moment { t }): Query<Moment>) -> Response {
    if !t.is_finite() {
        return (StatusCode::BAD_REQUEST, "expected a time t in seconds").into_response();
    }
    from_session(answering, move |session| session.at(t)).await
}

/// Answers from a session, read from its files beside the other requests.
async fn from_session<T: Serialize + Send + 'static>(
    answering: Answering,
    told: impl FnOnce(&BagView) -> Result<T, ViewError> + Send + 'static,
) -> Response {
    match answering.content {
        Content::Session(session) => match tokio::task::spawn_blocking(move || told(&session)).await {
            Ok(Ok(told)) => axum::Json(told).into_response(),
            Ok(Err(error)) => (StatusCode::INTERNAL_SERVER_ERROR, error.to_string()).into_response(),
            Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, error.to_string()).into_response(),
        },
        #[cfg(feature = "ros")]
        Content::Live(_) => StatusCode::NOT_FOUND.into_response(),
    }
}

/// Updates of a node, as they come.
#[cfg(feature = "ros")]
async fn updates(State(answering): State<Answering>) -> Response {
    match answering.content {
        Content::Live(feed) => axum::response::sse::Sse::new(feed.updates()).into_response(),
        Content::Session(_) => StatusCode::NOT_FOUND.into_response(),
    }
}
