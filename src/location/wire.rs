//! The HTTP client below the stores: what of it object_store has no setting for.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use async_trait::async_trait;
use object_store::client::{
    HttpClient, HttpConnector, HttpError, HttpErrorKind, HttpRequest, HttpResponse, HttpService, ReqwestConnector,
};
use object_store::{ClientOptions, HeaderValue};

/// How often a server that never answered is tried: an endpoint that is wrong is said within seconds.
const MAX_CONNECTS: usize = 3;

/// Makes clients.
#[derive(Debug)]
pub(super) struct Connector {
    /// Whether a multipart upload is to be completed only where nothing has its name.
    pub(super) only_new: bool,
}

impl HttpConnector for Connector {
    fn connect(&self, options: &ClientOptions) -> object_store::Result<HttpClient> {
        let client = ReqwestConnector::default().connect(options)?;
        let only_new = self.only_new;
        Ok(HttpClient::new(Wire { client, only_new, is_there: AtomicBool::new(false), n_tries: AtomicUsize::new(0) }))
    }
}

#[derive(Debug)]
struct Wire {
    client: HttpClient,
    only_new: bool,
    /// Whether the server ever answered.
    is_there: AtomicBool,
    n_tries: AtomicUsize,
}

#[async_trait]
impl HttpService for Wire {
    async fn call(&self, mut request: HttpRequest) -> Result<HttpResponse, HttpError> {
        let completes =
            request.method() == "POST" && request.uri().query().is_some_and(|query| query.contains("uploadId="));
        if self.only_new && completes {
            // S3 takes this header unsigned, as object_store itself sends it where it copies.
            request.headers_mut().insert("if-none-match", HeaderValue::from_static("*"));
        }
        match self.client.execute(request).await {
            Ok(answer) => {
                self.is_there.store(true, Ordering::Relaxed);
                Ok(answer)
            }
            Err(error) if error.kind() == HttpErrorKind::Connect && !self.is_there.load(Ordering::Relaxed) => {
                match self.n_tries.fetch_add(1, Ordering::Relaxed) + 1 {
                    n if n < MAX_CONNECTS => Err(error),
                    // One of a kind that isn't tried again.
                    _ => Err(HttpError::new(HttpErrorKind::Unknown, error)),
                }
            }
            Err(error) => Err(error),
        }
    }
}
