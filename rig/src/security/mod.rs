//! DDS Security, as ROS 2 sets it up: who may take part is decided by certificates of a keystore.
//!
//! `ROS_SECURITY_ENABLE=true` turns it on, `ROS_SECURITY_KEYSTORE` names the keystore, `ROS_SECURITY_ENCLAVE_OVERRIDE` the
//! enclave in it (default: the node's name), and `ROS_SECURITY_STRATEGY=Enforce` refuses to take part without.

#[cfg(feature = "security")]
mod refusals;

use std::path::{Path, PathBuf};

use ros2_client::dds::rustdds::DomainParticipantBuilder;

#[cfg(feature = "security")]
pub use self::refusals::{refusals, start_log};
use crate::error::{Error, Result};

/// Whether this program can authenticate peers at all.
const BUILT_IN: bool = cfg!(feature = "security");

/// Files of an enclave, as `ros2 security` names them.
const FILES: [&str; 6] = [
    "identity_ca.cert.pem",
    "cert.pem",
    "key.pem",
    "permissions_ca.cert.pem",
    "governance.p7s",
    "permissions.p7s",
];

/// What the environment asks for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Protection {
    /// Peers are not authenticated, and why.
    Off(String),
    /// Peers are authenticated by the files in this folder.
    Enclave(PathBuf),
}

impl Protection {
    /// What the environment asks for a node with this name.
    ///
    /// # Errors
    /// [`Error::Refused`] where security is enforced and cannot be had, or a variable has no known value.
    pub fn of_environment(node: &str) -> Result<Self> {
        Self::of(&|name| std::env::var(name).ok(), node, BUILT_IN)
    }

    fn of(read: &dyn Fn(&str) -> Option<String>, node: &str, built_in: bool) -> Result<Self> {
        let value = |name: &str| read(name).filter(|value| !value.is_empty());
        let word = |name: &str, known: [&str; 2]| match value(name) {
            None => Ok(false),
            Some(value) if value.eq_ignore_ascii_case(known[1]) => Ok(false),
            Some(value) if value.eq_ignore_ascii_case(known[0]) => Ok(true),
            Some(value) => Err(Error::refused(format!(
                "{name}: expected {} or {}, found {value}",
                known[0], known[1]
            ))),
        };
        let enforced = word("ROS_SECURITY_STRATEGY", ["Enforce", "Permissive"])?;
        if !word("ROS_SECURITY_ENABLE", ["true", "false"])? {
            return Ok(Self::Off("ROS_SECURITY_ENABLE is not true".to_owned()));
        }
        let missing = if built_in {
            match Self::enclave(&value, node) {
                Ok(folder) => return Ok(Self::Enclave(folder)),
                Err(why) => why,
            }
        } else {
            "this program is built without DDS Security (cargo build --features security)"
                .to_owned()
        };
        if enforced {
            return Err(Error::refused(format!(
                "ROS_SECURITY_STRATEGY is Enforce, and peers cannot be authenticated: {missing}"
            )));
        }
        Ok(Self::Off(missing))
    }

    /// The folder of the node's enclave, in which all files are there.
    fn enclave(
        value: &dyn Fn(&str) -> Option<String>,
        node: &str,
    ) -> std::result::Result<PathBuf, String> {
        let keystore = value("ROS_SECURITY_KEYSTORE").ok_or("ROS_SECURITY_KEYSTORE is not set")?;
        let name = value("ROS_SECURITY_ENCLAVE_OVERRIDE").unwrap_or_else(|| format!("/{node}"));
        let folder = Path::new(&keystore)
            .join("enclaves")
            .join(name.trim_matches('/'));
        if let Some(file) = FILES.iter().find(|file| !folder.join(file).is_file()) {
            return Err(format!("{}: is missing", folder.join(file).display()));
        }
        let governance = folder.join("governance.p7s");
        let rules = std::fs::read(&governance)
            .map_err(|error| format!("{}: cannot be read: {error}", governance.display()))?;
        match gap(&String::from_utf8_lossy(&rules)) {
            Some(gap) => Err(format!("{}: {gap}", governance.display())),
            None => Ok(folder),
        }
    }
}

/// A participant under these rules.
#[cfg(feature = "security")]
pub fn protected(
    builder: DomainParticipantBuilder,
    protection: &Protection,
) -> DomainParticipantBuilder {
    use ros2_client::dds::rustdds::DomainParticipantSecurityConfigFiles;
    match protection {
        Protection::Off(_) => builder,
        Protection::Enclave(folder) => builder.builtin_security(
            DomainParticipantSecurityConfigFiles::with_ros_default_names(folder, String::new()),
        ),
    }
}

/// A participant without rules: there are none in this build.
#[cfg(not(feature = "security"))]
pub fn protected(builder: DomainParticipantBuilder, _: &Protection) -> DomainParticipantBuilder {
    builder
}

/// The first rule of a governance document that lets in who has no certificate.
fn gap(governance: &str) -> Option<&'static str> {
    let values = |name: &str| {
        let parts: Vec<&str> = governance.split(&format!("<{name}>")).skip(1).collect();
        let values = parts.into_iter().filter_map(|part| part.split('<').next());
        values
            .map(|value| value.trim().to_ascii_lowercase())
            .collect::<Vec<_>>()
    };
    let open = values("allow_unauthenticated_participants");
    if open.is_empty() || open.iter().any(|value| value != "false" && value != "0") {
        return Some("allow_unauthenticated_participants: expected false");
    }
    let packets = values("rtps_protection_kind");
    if packets.is_empty() || packets.iter().any(|value| value == "none") {
        return Some(
            "rtps_protection_kind: expected SIGN or ENCRYPT, without which anyone can forge a peer's packets",
        );
    }
    None
}

/// What the library has refused since the last call: nothing is refused in this build.
#[cfg(not(feature = "security"))]
pub fn refusals() -> Vec<String> {
    Vec::new()
}

/// Starts the log of this program.
#[cfg(not(feature = "security"))]
pub fn start_log(environment: env_logger::Env<'_>) {
    env_logger::Builder::from_env(environment).init();
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(variables: &[(&str, &str)], built_in: bool) -> Result<Protection> {
        let read = |name: &str| {
            let found = variables.iter().find(|(one, _)| *one == name);
            found.map(|(_, value)| (*value).to_owned())
        };
        Protection::of(&read, "rig", built_in)
    }

    const ENABLED: (&str, &str) = ("ROS_SECURITY_ENABLE", "true");
    const ENFORCED: (&str, &str) = ("ROS_SECURITY_STRATEGY", "Enforce");

    #[test]
    fn without_being_asked_for_it_is_off() {
        for variables in [&[][..], &[ENFORCED], &[("ROS_SECURITY_ENABLE", "false")]] {
            let found = of(variables, true).expect("nothing is asked for");
            assert!(matches!(found, Protection::Off(_)), "{variables:?}");
        }
    }

    #[test]
    fn what_is_enforced_and_cannot_be_had_is_refused() {
        for (variables, built_in, said) in [
            (
                &[ENABLED, ENFORCED][..],
                false,
                "built without DDS Security",
            ),
            (
                &[ENABLED, ENFORCED],
                true,
                "ROS_SECURITY_KEYSTORE is not set",
            ),
            (
                &[ENABLED, ENFORCED, ("ROS_SECURITY_KEYSTORE", "/nowhere")],
                true,
                "/nowhere/enclaves/rig/identity_ca.cert.pem: is missing",
            ),
            (
                &[("ROS_SECURITY_ENABLE", "1")],
                true,
                "expected true or false, found 1",
            ),
            (
                &[ENABLED, ("ROS_SECURITY_STRATEGY", "strict")],
                true,
                "expected Enforce or Permissive",
            ),
        ] {
            let error = of(variables, built_in).expect_err(said).to_string();
            assert!(error.contains(said), "{error}");
        }
    }

    #[test]
    fn what_is_not_enforced_is_off_and_says_why() {
        for (built_in, why) in [
            (false, "built without DDS Security"),
            (true, "ROS_SECURITY_KEYSTORE is not set"),
        ] {
            match of(&[ENABLED], built_in).expect("it is not enforced") {
                Protection::Off(said) => assert!(said.contains(why), "{said}"),
                Protection::Enclave(folder) => panic!("{}", folder.display()),
            }
        }
    }

    const STRICT: &str =
        "<allow_unauthenticated_participants> false </allow_unauthenticated_participants>
        <rtps_protection_kind>SIGN</rtps_protection_kind>";

    #[test]
    fn rules_that_let_anyone_in_are_no_protection() {
        assert_eq!(gap(STRICT), None);
        for (old, new, said) in [
            (" false ", "true", "allow_unauthenticated_participants"),
            (STRICT, "", "allow_unauthenticated_participants"),
            ("SIGN", "NONE", "rtps_protection_kind"),
        ] {
            let found = gap(&STRICT.replace(old, new)).expect(said);
            assert!(found.starts_with(said), "{found}");
        }
        // Each rule of several counts.
        assert!(gap(&format!("{STRICT}{}", STRICT.replace("SIGN", "NONE"))).is_some());
    }

    #[test]
    fn an_enclave_has_the_name_of_the_node_or_that_of_the_environment() {
        let keystore = std::env::temp_dir().join(format!("rig-keystore-{}", std::process::id()));
        for name in ["rig", "lab/arms"] {
            let enclave = keystore.join("enclaves").join(name);
            std::fs::create_dir_all(&enclave).expect("there is room");
            for file in FILES {
                std::fs::write(enclave.join(file), STRICT).expect("there is room");
            }
        }
        let store = keystore.display().to_string();
        let named = ("ROS_SECURITY_KEYSTORE", store.as_str());
        let other = ("ROS_SECURITY_ENCLAVE_OVERRIDE", "/lab/arms");
        let own = of(&[ENABLED, ENFORCED, named], true);
        let overridden = of(&[ENABLED, named, other], true);
        std::fs::remove_dir_all(&keystore).expect("it is there");
        let enclaves = keystore.join("enclaves");
        assert_eq!(own, Ok(Protection::Enclave(enclaves.join("rig"))));
        assert_eq!(
            overridden,
            Ok(Protection::Enclave(enclaves.join("lab/arms")))
        );
    }
}
