//! What can't be had is one line: what was asked, what came, what to do; within seconds, and without a credential.

use std::fs;
use std::time::{Duration, Instant};

use crate::common::bags::write_session;
use crate::common::tpf::Run;
use crate::server::Cloud;

const SOON: Duration = Duration::from_secs(20);

fn refused(cloud: &Cloud, args: &[&str], settings: &[(&str, &str)], without: &[&str]) -> String {
    let mut command = cloud.command(args);
    command.envs(settings.iter().copied());
    for name in without {
        command.env_remove(name);
    }
    let began = Instant::now();
    let run = Run::from(command.output().unwrap());
    assert!(began.elapsed() < SOON, "{:?}: {run:?}", began.elapsed());
    let line = run.failure().to_owned();
    assert!(!run.stderr.contains(crate::server::SECRET) && !line.contains("wrongsecret"), "{line}");
    line
}

#[test]
fn what_a_store_refuses_is_one_line_that_says_what_to_do() {
    let Some(cloud) = Cloud::start() else { return };
    write_session(&cloud.folder().join("bag.mcap"), 1);
    cloud.put("bag.mcap", "bag.mcap");
    let inspect =
        |uri: &str, settings: &[(&str, &str)], without: &[&str]| refused(&cloud, &["inspect", uri], settings, without);
    let says = |line: String, words: &[&str]| {
        assert!(words.iter().all(|word| line.contains(word)), "{line:?} lacks one of {words:?}");
    };
    says(inspect("s3://bags/no.mcap", &[], &[]), &["s3://bags/no.mcap", "not found"]);
    says(inspect("s3://bags/no/folder", &[], &[]), &["s3://bags/no/folder", "not found"]);
    says(inspect("s3://none/bag.mcap", &[], &[]), &["there is no bucket \"none\""]);
    says(
        inspect("s3://bags/bag.mcap", &[("AWS_SECRET_ACCESS_KEY", "wrongsecret")], &[]),
        &["403 Forbidden", "may not read the bucket \"bags\"", "AWS_PROFILE"],
    );
    says(inspect("s3://bags/bag.mcap", &[("AWS_ACCESS_KEY_ID", "AKIAOTHER")], &[]), &["403 Forbidden", "AWS_PROFILE"]);
    says(
        inspect("s3://bags/bag.mcap", &[("AWS_ENDPOINT_URL", "http://127.0.0.1:1")], &[]),
        &["refused", "check the endpoint"],
    );
    says(
        inspect("s3://bags/bag.mcap", &[("AWS_ENDPOINT_URL", "http://no.such.host.invalid")], &[]),
        &["check the endpoint"],
    );
    let keys = ["AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"];
    says(inspect("s3://bags/bag.mcap", &[], &keys), &["no credentials were found", "AWS_PROFILE"]);
    says(
        inspect("s3://bags/bag.mcap", &[("AWS_PROFILE", "nobody")], &keys),
        &["the profile \"nobody\" (AWS_PROFILE) is in neither"],
    );
    says(inspect("ftp://bags/bag.mcap", &[], &[]), &["ftp:// is not known", "s3://"]);
    says(inspect("https://user:pw@host/bag.mcap", &[], &[]), &["a user, a password or a query"]);
    // Other stores: nothing of theirs is in reach, which is said as soon.
    says(inspect("gs://bags/bag.mcap", &[], &[]), &["gs://bags/bag.mcap", "gcloud auth application-default login"]);
    says(inspect("az://bags/bag.mcap", &[], &[]), &["az://bags/bag.mcap", "AZURE_STORAGE_ACCOUNT"]);

    let init = |out: &str, settings: &[(&str, &str)]| refused(&cloud, &["init", "bag.mcap", "-o", out], settings, &[]);
    says(init("s3://none/params.yaml", &[]), &["there is no bucket \"none\""]);
    says(init("s3://bags/params.yaml", &[("AWS_SECRET_ACCESS_KEY", "wrongsecret")]), &["403 Forbidden"]);
    says(init("s3://bags", &[]), &["names a whole bucket"]);
    says(init("http://127.0.0.1:1/params.yaml", &[]), &["a web server takes no outputs"]);
    says(refused(&cloud, &["demo", "-o", "s3://bags/demo"], &[], &[]), &["made on this machine only"]);
    assert_eq!(cloud.objects(), ["bag.mcap"]);
}

#[test]
fn a_profile_of_the_aws_tools_gives_credentials_and_endpoint() {
    let Some(cloud) = Cloud::start() else { return };
    write_session(&cloud.folder().join("bag.mcap"), 1);
    cloud.put("bag.mcap", "bag.mcap");
    let aws = cloud.folder().join("home/.aws");
    fs::create_dir(&aws).unwrap();
    let keys = format!("[glove]\naws_access_key_id = AKIATEST\naws_secret_access_key = {}\n", crate::server::SECRET);
    fs::write(aws.join("credentials"), keys).unwrap();
    let endpoint = format!("http://127.0.0.1:{}", cloud.proxy.port);
    fs::write(aws.join("config"), format!("[profile glove]\nregion = eu-central-1\nendpoint_url = {endpoint}\n"))
        .unwrap();
    let mut command = cloud.command(&["inspect", "s3://bags/bag.mcap"]);
    for name in ["AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_ENDPOINT_URL"] {
        command.env_remove(name);
    }
    Run::from(command.env("AWS_PROFILE", "glove").output().unwrap()).ok();

    fs::write(aws.join("credentials"), "[sso]\nsso_session = company\n").unwrap();
    let told = refused(
        &cloud,
        &["inspect", "s3://bags/bag.mcap"],
        &[("AWS_PROFILE", "sso")],
        &["AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"],
    );
    assert!(told.contains("has sso_session and no keys: run `eval \"$(aws configure export-credentials"), "{told}");
}
