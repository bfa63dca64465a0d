//! Stores by the first part of a URI, with the settings and credentials of the environment, and a way to wait for them.

use std::collections::HashMap;
use std::collections::hash_map::DefaultHasher;
use std::future::Future;
use std::hash::{Hash as _, Hasher as _};
use std::io;
use std::sync::atomic::Ordering;
use std::sync::{Arc, LazyLock, Mutex, Once, PoisonError};
use std::time::Duration;

use object_store::aws::{AmazonS3Builder, AmazonS3ConfigKey};
use object_store::azure::{AzureConfigKey, MicrosoftAzureBuilder};
use object_store::gcp::{GoogleCloudStorageBuilder, GoogleConfigKey};
use object_store::http::HttpBuilder;
use object_store::path::Path as Key;
use object_store::{BackoffConfig, ClientConfigKey, ObjectStore, RetryConfig};
use tokio::runtime::Runtime;

use super::credentials::Profile;
use super::refusal;
use super::trouble::{Asked, of_settings, told};
use super::uri::{Scheme, Uri};
use super::wire::Connector;
use crate::leave;
use crate::observer::{CancelFlag, cancel_flag};

/// Waiting for a connection; one request that failed is tried again up to [`MAX_RETRIES`] times within [`RETRY_TIMEOUT`].
const CONNECT_TIMEOUT: &str = "5s";
/// Waiting for the next bytes of an answer.
const READ_TIMEOUT: &str = "10s";
/// All of one request: 8 MiB at 140 kB/s.
const TIMEOUT: &str = "60s";
const MAX_RETRIES: usize = 8;
const RETRY_TIMEOUT: Duration = Duration::from_secs(45);
const FIRST_PAUSE: Duration = Duration::from_millis(100);
const LONGEST_PAUSE: Duration = Duration::from_secs(5);

/// Between looks at whether the process is to end.
const SLICE: Duration = Duration::from_millis(50);

/// A bucket, a container or a web server.
pub(super) struct Store {
    pub(super) objects: Box<dyn ObjectStore>,
    runtime: Runtime,
}

impl std::fmt::Debug for Store {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Store") // what is in it are credentials
    }
}

/// Stores that were opened, by what they were opened with.
type Open = HashMap<(u32, u64, Scheme, String, bool), Arc<Store>>;

/// The store of a URI. It is made anew where the environment's credentials are others than before, and in a process that was
/// forked.
pub(super) fn of(uri: &Uri) -> io::Result<Arc<Store>> {
    that_replaces(uri, true)
}

/// The same. Without `overwrite`, an upload in parts is completed only where nothing has its name, as far as S3 goes.
pub(super) fn that_replaces(uri: &Uri, overwrite: bool) -> io::Result<Arc<Store>> {
    static OPEN: LazyLock<Mutex<Open>> = LazyLock::new(Mutex::default);
    let key = (std::process::id(), environment(), uri.scheme, uri.bucket.clone(), overwrite);
    let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(store) = open.get(&key) {
        return Ok(Arc::clone(store));
    }
    let store = Arc::new(Store::new(uri, !overwrite)?);
    open.insert(key, Arc::clone(&store));
    Ok(store)
}

/// Tells environments with other settings apart.
fn environment() -> u64 {
    let mut settings: Vec<_> = std::env::vars_os()
        .filter(|(name, _)| ["AWS_", "GOOGLE_", "AZURE_"].iter().any(|of| name.to_string_lossy().starts_with(of)))
        .collect();
    settings.sort();
    let mut hash = DefaultHasher::new();
    settings.hash(&mut hash);
    hash.finish()
}

/// The name of a URI's object within its store.
pub(super) fn key(uri: &Uri) -> io::Result<Key> {
    let invalid = |error: object_store::path::Error| refusal(io::ErrorKind::InvalidInput, error.to_string());
    Key::parse(&uri.key).map_err(invalid)
}

impl Store {
    fn new(uri: &Uri, only_new: bool) -> io::Result<Self> {
        static TLS: Once = Once::new();
        TLS.call_once(|| {
            // Another one that is installed already does as well.
            let _ = rustls::crypto::ring::default_provider().install_default();
        });
        let objects = match uri.scheme {
            Scheme::S3 => s3(uri, only_new)?,
            Scheme::Gs => gs(uri).map_err(|error| of_settings(uri, &error))?,
            Scheme::Az => az(uri).map_err(|error| of_settings(uri, &error))?,
            Scheme::Http | Scheme::Https => web(uri).map_err(|error| of_settings(uri, &error))?,
        };
        // On the thread that waits: a process that forks leaves no thread behind.
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        Ok(Store { objects, runtime })
    }

    /// Waits for a store's answer, unless the process is to end or the work of this thread is cancelled.
    pub(super) fn wait<T: Send>(
        &self,
        uri: &Uri,
        asked: Asked,
        answer: impl Future<Output = object_store::Result<T>> + Send,
    ) -> io::Result<T> {
        let cancel = cancel_flag();
        let answer = async {
            tokio::select! {
                biased;
                () = asked_to_end(cancel) => Err(refusal(io::ErrorKind::Other, "interrupted")),
                answer = answer => answer.map_err(|error| told(uri, asked, &error)),
            }
        };
        self.run(answer)
    }

    /// Runs to its end what must not be left undone.
    pub(super) fn run<T: Send>(&self, future: impl Future<Output = T> + Send) -> T {
        if tokio::runtime::Handle::try_current().is_err() {
            return self.runtime.block_on(future);
        }
        // A thread of somebody's own runtime may not wait for another.
        let ended = std::thread::scope(|scope| scope.spawn(|| self.runtime.block_on(future)).join());
        ended.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

async fn asked_to_end(cancel: CancelFlag) {
    let is_cancelled = || cancel.as_ref().is_some_and(|flag| flag.load(Ordering::Relaxed));
    while !leave::asked() && !is_cancelled() {
        tokio::time::sleep(SLICE).await;
    }
}

fn retries() -> RetryConfig {
    let backoff = BackoffConfig { init_backoff: FIRST_PAUSE, max_backoff: LONGEST_PAUSE, base: 2.0 };
    RetryConfig { backoff, max_retries: MAX_RETRIES, retry_timeout: RETRY_TIMEOUT }
}

/// Settings of the client.
fn client_settings() -> [(ClientConfigKey, &'static str); 4] {
    [
        (ClientConfigKey::ConnectTimeout, CONNECT_TIMEOUT),
        (ClientConfigKey::ReadTimeout, READ_TIMEOUT),
        (ClientConfigKey::Timeout, TIMEOUT),
        (ClientConfigKey::UserAgent, concat!("tactile_pose_fusion/", env!("CARGO_PKG_VERSION"))),
    ]
}

fn s3(uri: &Uri, only_new: bool) -> io::Result<Box<dyn ObjectStore>> {
    let mut builder = AmazonS3Builder::from_env().with_bucket_name(&uri.bucket).with_retry(retries());
    for (key, value) in client_settings() {
        builder = builder.with_config(AmazonS3ConfigKey::Client(key), value);
    }
    let is_set = |builder: &AmazonS3Builder, key| builder.get_config_value(&key).is_some();
    let set_false = ["false", "0", "off", "no", "n"];
    let skips = builder
        .get_config_value(&AmazonS3ConfigKey::SkipSignature)
        .is_some_and(|value| !set_false.contains(&value.to_ascii_lowercase().as_str()));
    let has_own = skips
        || is_set(&builder, AmazonS3ConfigKey::AccessKeyId)
        || is_set(&builder, AmazonS3ConfigKey::SecretAccessKey)
        || is_set(&builder, AmazonS3ConfigKey::WebIdentityTokenFile);
    // A profile counts for the region and the endpoint, too, and its keys where the environment has no credentials.
    let profile = match Profile::of_environment() {
        Ok(profile) => profile,
        Err(_) if has_own => Profile::default(),
        Err(error) => return Err(error),
    };
    let settings = [
        ("region", AmazonS3ConfigKey::DefaultRegion, AmazonS3ConfigKey::Region),
        ("endpoint_url", AmazonS3ConfigKey::Endpoint, AmazonS3ConfigKey::S3Endpoint),
    ];
    for (name, key, other) in settings {
        if let Some(value) = profile.get(name).filter(|_| !is_set(&builder, key) && !is_set(&builder, other)) {
            builder = builder.with_config(key, value);
        }
    }
    if let Some((id, secret)) = profile.keys().filter(|_| !has_own) {
        builder = builder.with_access_key_id(id).with_secret_access_key(secret);
        if let Some(token) = profile.get("aws_session_token") {
            builder = builder.with_token(token);
        }
    }
    // The tools of AWS take an endpoint of http:// without being asked twice.
    let endpoint = builder
        .get_config_value(&AmazonS3ConfigKey::S3Endpoint)
        .or_else(|| builder.get_config_value(&AmazonS3ConfigKey::Endpoint));
    if endpoint.is_some_and(|endpoint| endpoint.starts_with("http://")) {
        builder = builder.with_allow_http(true);
    }
    let built = builder.with_http_connector(Connector { only_new }).build();
    built.map(|store| Box::new(store) as _).map_err(|error| of_settings(uri, &error))
}

fn gs(uri: &Uri) -> object_store::Result<Box<dyn ObjectStore>> {
    let mut builder = GoogleCloudStorageBuilder::from_env().with_bucket_name(&uri.bucket).with_retry(retries());
    for (key, value) in client_settings() {
        builder = builder.with_config(GoogleConfigKey::Client(key), value);
    }
    Ok(Box::new(builder.with_http_connector(Connector { only_new: false }).build()?))
}

fn az(uri: &Uri) -> object_store::Result<Box<dyn ObjectStore>> {
    let mut builder = MicrosoftAzureBuilder::from_env().with_container_name(&uri.bucket).with_retry(retries());
    for (key, value) in client_settings() {
        builder = builder.with_config(AzureConfigKey::Client(key), value);
    }
    // By these names `az` takes them.
    for (name, key) in
        [("AZURE_STORAGE_ACCOUNT", AzureConfigKey::AccountName), ("AZURE_STORAGE_KEY", AzureConfigKey::AccessKey)]
    {
        if let (Ok(value), None) = (std::env::var(name), builder.get_config_value(&key)) {
            builder = builder.with_config(key, value);
        }
    }
    Ok(Box::new(builder.with_http_connector(Connector { only_new: false }).build()?))
}

fn web(uri: &Uri) -> object_store::Result<Box<dyn ObjectStore>> {
    let scheme = if uri.scheme == Scheme::Http { "http" } else { "https" };
    let mut builder = HttpBuilder::new().with_url(format!("{scheme}://{}", uri.bucket)).with_retry(retries());
    for (key, value) in client_settings() {
        builder = builder.with_config(key, value);
    }
    builder = builder.with_config(ClientConfigKey::AllowHttp, "true");
    Ok(Box::new(builder.with_http_connector(Connector { only_new: false }).build()?))
}
