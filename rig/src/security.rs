//! DDS Security: which programs may take part.

use std::path::Path;

use ros2_client::dds::rustdds::DomainParticipantBuilder;

use crate::config::Network;
use crate::error::{Error, Result};

/// The files of an enclave of an SROS2 keystore that are needed.
const FILES: [&str; 6] = [
    "identity_ca.cert.pem",
    "cert.pem",
    "key.pem",
    "permissions_ca.cert.pem",
    "governance.p7s",
    "permissions.p7s",
];

/// Warning about a network on which anybody may take part.
pub fn warning(network: &Network) -> Option<String> {
    let addresses: Vec<String> = network.interfaces.iter().map(ToString::to_string).collect();
    network.security.is_none().then(|| {
        format!(
            "network.security is not set: no peer is authenticated; every program that reaches {} can pose as tracker or arms, and stop a run",
            addresses.join(", ")
        )
    })
}

/// A participant that speaks to authenticated peers alone, if the configuration names an enclave.
///
/// # Errors
/// [`Error::Refused`] for a folder that is no enclave, and for a rig that was built without DDS Security.
pub fn secured(
    builder: DomainParticipantBuilder,
    enclave: Option<&Path>,
) -> Result<DomainParticipantBuilder> {
    let Some(enclave) = enclave else {
        return Ok(builder);
    };
    if let Some(missing) = FILES.iter().find(|name| !enclave.join(name).is_file()) {
        return Err(Error::refused(format!(
            "network.security: {} has no {missing}; expected the folder of an enclave of an SROS2 keystore, with {}",
            enclave.display(),
            FILES.join(", ")
        )));
    }
    authenticated(builder, enclave)
}

#[cfg(feature = "security")]
#[expect(
    clippy::unnecessary_wraps,
    reason = "without DDS Security it is refused"
)]
fn authenticated(
    builder: DomainParticipantBuilder,
    enclave: &Path,
) -> Result<DomainParticipantBuilder> {
    use ros2_client::dds::rustdds::DomainParticipantSecurityConfigFiles;
    // RustDDS reads keys without a password alone, as SROS2 writes them.
    let files =
        DomainParticipantSecurityConfigFiles::with_ros_default_names(enclave, String::new());
    Ok(builder.builtin_security(files))
}

#[cfg(not(feature = "security"))]
fn authenticated(_: DomainParticipantBuilder, _: &Path) -> Result<DomainParticipantBuilder> {
    Err(Error::refused(
        "network.security: this rig was built without DDS Security; 'cargo build --package rig --release --features security' adds it (it needs OpenSSL's headers)",
    ))
}
