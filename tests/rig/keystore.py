"""A keystore as ``ros2 security`` makes it, by OpenSSL: one authority, and an enclave for each node."""

from __future__ import annotations

import subprocess
from pathlib import Path

_GOVERNANCE = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
  xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_governance.xsd">
  <domain_access_rules><domain_rule>
    <domains><id_range><min>0</min><max>230</max></id_range></domains>
    <allow_unauthenticated_participants>false</allow_unauthenticated_participants>
    <enable_join_access_control>true</enable_join_access_control>
    <discovery_protection_kind>ENCRYPT</discovery_protection_kind>
    <liveliness_protection_kind>ENCRYPT</liveliness_protection_kind>
    <rtps_protection_kind>{rtps}</rtps_protection_kind>
    <topic_access_rules><topic_rule>
      <topic_expression>*</topic_expression>
      <enable_discovery_protection>true</enable_discovery_protection>
      <enable_liveliness_protection>true</enable_liveliness_protection>
      <enable_read_access_control>true</enable_read_access_control>
      <enable_write_access_control>true</enable_write_access_control>
      <metadata_protection_kind>ENCRYPT</metadata_protection_kind>
      <data_protection_kind>ENCRYPT</data_protection_kind>
    </topic_rule></topic_access_rules>
  </domain_rule></domain_access_rules>
</dds>
"""

_PERMISSIONS = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
  xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_permissions.xsd">
  <permissions><grant name="/{node}">
    <subject_name>CN=/{node}</subject_name>
    <validity><not_before>2020-01-01T00:00:00</not_before><not_after>2120-01-01T00:00:00</not_after></validity>
    <allow_rule>
      <domains><id_range><min>0</min><max>230</max></id_range></domains>
      <publish><topics><topic>*</topic></topics></publish>
      <subscribe><topics><topic>*</topic></topics></subscribe>
    </allow_rule>
    <default>DENY</default>
  </grant></permissions>
</dds>
"""


def _openssl(*words: str | Path, folder: Path) -> None:
    done = subprocess.run(
        ["openssl", *map(str, words)], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def make(folder: Path, *nodes: str, rtps: str = "SIGN") -> Path:
    """Make a keystore with an enclave for each of these nodes."""
    authority, enclaves = folder / "authority", folder / "enclaves"
    authority.mkdir(parents=True)
    _openssl("ecparam", "-name", "prime256v1", "-out", "curve.pem", folder=authority)
    new = ("-newkey", "param:curve.pem", "-nodes", "-sha256")
    # An authority of its own name: those of two keystores differ by their keys alone.
    _openssl(
        *("req", "-x509", *new, "-subj", "/CN=sros2CA", "-days", "3650"),
        *("-keyout", "ca.key.pem", "-out", "ca.cert.pem"),
        folder=authority,
    )
    (authority / "governance.xml").write_text(_GOVERNANCE.format(rtps=rtps))
    for serial, node in enumerate(nodes, start=2):
        enclave = enclaves / node
        enclave.mkdir(parents=True)
        for name in ("identity_ca", "permissions_ca"):
            (enclave / f"{name}.cert.pem").write_bytes((authority / "ca.cert.pem").read_bytes())
        _openssl(
            *("req", *new, "-subj", f"/CN=\\/{node}", "-keyout", enclave / "key.pem"),
            *("-out", f"{node}.csr"),
            folder=authority,
        )
        _openssl(
            *("x509", "-req", "-sha256", "-days", "3650", "-in", f"{node}.csr", "-set_serial", f"{serial}"),
            *("-CA", "ca.cert.pem", "-CAkey", "ca.key.pem", "-out", enclave / "cert.pem"),
            folder=authority,
        )
        (authority / f"{node}.xml").write_text(_PERMISSIONS.format(node=node))
        for source, target in (("governance", "governance"), (node, "permissions")):
            _openssl(
                *("smime", "-sign", "-text", "-md", "sha256", "-in", f"{source}.xml"),
                *("-signer", "ca.cert.pem", "-inkey", "ca.key.pem", "-out", enclave / f"{target}.p7s"),
                folder=authority,
            )
    return folder
