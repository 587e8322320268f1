"""Folders of keys: made, completed, renewed, revoked."""

import json
import stat
from contextlib import suppress
from datetime import UTC, datetime, timedelta

import pytest
from cryptography import x509
from in_process import formnet

from formnet.formation.machines.custody import KeysError
from formnet.formation.machines.generations import Generations
from formnet.formation.wire.security import MONITOR, PLANT, Credentials, robot_name
from formnet.lab.machines import authority, keys
from formnet.lab.machines.keys import Unusable
from formnet.lab.scenarios.packaged import CONFIGS

OTHER_USER = 12345
SCENARIO = CONFIGS / "paper" / "section5-delay.toml"


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


# --- making keys -----------------------------------------------------------------------------


def test_keys_are_private_and_never_overwritten(tmp_path):
    place = tmp_path / "keys"
    code, said = formnet("keys", "init", place, "--robots", "1-2,7", "--hosts", "10.0.0.9, lab-pc")
    assert code == 0
    names = {"plant", "monitor", "robot-1", "robot-2", "robot-7", "ca"}
    expected = {f"{name}{end}" for name in names for end in (".pem", "-key.pem")}
    expected.add("generations.json")
    assert {path.name for path in place.iterdir()} == expected
    assert len(said.split()) == len(expected)
    assert stat.S_IMODE(place.stat().st_mode) == 0o700
    for path in place.glob("*-key.pem"):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        assert b"PRIVATE KEY" in path.read_bytes()
    before = contents(place)
    code, said = formnet("keys", "init", place, "--robots", "1-2")
    assert code == 2
    assert "has all of these keys already" in said
    assert contents(place) == before
    assert formnet("keys", "init", place, "--robots", "1-3")[0] == 0  # one more
    after = contents(place)
    assert after.keys() - expected == {"robot-3.pem", "robot-3-key.pem"}
    assert {name for name in before if after[name] != before[name]} == {"generations.json"}
    (place / "ca-key.pem").unlink()
    code, said = formnet("keys", "init", place, "--robots", "1-9")
    assert code == 2
    assert "certificates are made where the authority's key is" in said


def test_certificates_say_who_and_where(made):
    signer = x509.load_pem_x509_certificate((made / "ca.pem").read_bytes())
    for name in (PLANT, MONITOR, robot_name(3)):
        found = x509.load_pem_x509_certificate((made / f"{name}.pem").read_bytes())
        found.verify_directly_issued_by(signer)
        assert found.subject.rfc4514_string() == f"CN={name}.1"
        left = found.not_valid_after_utc - datetime.now(UTC)
        assert timedelta(days=29) < left <= timedelta(days=30)
    left = signer.not_valid_after_utc - datetime.now(UTC)
    assert left > timedelta(days=3649)  # it renews what ends
    assert served(made) == {"localhost", "lab-pc", "127.0.0.1", "::1", "10.1.2.3"}


def served(folder):
    """The names and addresses in the plant's certificate."""
    plant = x509.load_pem_x509_certificate((folder / "plant.pem").read_bytes())
    names = plant.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    addresses = map(str, names.get_values_for_type(x509.IPAddress))
    return {*names.get_values_for_type(x509.DNSName), *addresses}


@pytest.mark.parametrize("text", ["", "a", "3-1", "1-", "1,,2", "-1", "1-9999999", "²", "١"])
def test_what_is_no_list_of_robots_is_said(tmp_path, text):
    code, said = formnet("keys", "init", tmp_path / "keys", "--robots", text)
    assert code == 2
    assert "--robots:" in said
    assert not (tmp_path / "keys").exists()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("läb", "must be ASCII: write the A-label"),
        ("10.0.0", "must be an IPv4 address"),
        ("10.0.0.256", "must be an IPv4 address"),
        ("[fd00::1", "must be an IPv6 address"),
        ("[10.0.0.1]", "must be an IPv6 address"),
        ("fe80::1%eth0", "must have no zone"),
        ("*.example.org", "must be one address or host name"),
        ("-lab", "must be one address or host name"),
        ("lab..pc", "must be one address or host name"),
        ("a" * 64, "must be one address or host name"),
        (".".join(["a" * 60] * 5), "must be one address or host name"),
        ("lab-pc,,x", "must name a machine"),
        ("lab pc", "no spaces or control characters"),
        ("lab\tpc", "no spaces or control characters"),
        ("lab\x1b]0;pc", "no spaces or control characters"),
        ("lab\u00a0pc", "no spaces or control characters"),
    ],
)
def test_what_is_no_name_of_the_plant_is_said(tmp_path, text, words):
    code, said = formnet("keys", "init", tmp_path / "keys", "--robots", "1", "--hosts", text)
    assert code == 2
    assert words in said
    assert not (tmp_path / "keys").exists()


def test_an_address_is_one_whatever_stands_around_it(tmp_path):
    place = tmp_path / "keys"
    texts = " 10.0.0.1, [fd00::1],xn--lb-via "
    assert formnet("keys", "init", place, "--robots", "1", "--hosts", texts)[0] == 0
    assert served(place) >= {"10.0.0.1", "fd00::1", "xn--lb-via"}
    plant = x509.load_pem_x509_certificate((place / "plant.pem").read_bytes())
    names = plant.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["localhost", "xn--lb-via"]


# --- half of it ------------------------------------------------------------------------------


def unpaired(folder):
    """Of whom there is a private key and no certificate."""
    found = (path.name.removesuffix("-key.pem") for path in folder.glob("*-key.pem"))
    return [name for name in found if not (folder / f"{name}.pem").exists()]


def test_an_interrupted_init_can_be_repeated_or_says_what_to_do(tmp_path, monkeypatch):
    """It is killed before each of its writes in turn."""
    real, halves = keys.files.write_new, []
    for stop in range(9):
        place, writes = tmp_path / f"keys{stop}", []

        def write(path, data, mode, stop=stop, writes=writes):
            writes.append(path.name)
            if len(writes) > stop:
                raise KeyboardInterrupt
            real(path, data, mode)

        with monkeypatch.context() as patch:
            patch.setattr(keys.files, "write_new", write)
            with pytest.raises(KeyboardInterrupt):
                keys.make(place, [1], [], 30)
        halves.append(len(list(place.iterdir())))
        for name in unpaired(place):
            with pytest.raises(Unusable) as found:
                keys.make(place, [1], [], 30)
            if name == "ca":
                assert "if ca-key.pem has never signed anything, delete ca-key.pem" in str(
                    found.value
                )
                (place / "ca-key.pem").unlink()
            else:
                assert f"`formnet keys renew {place} {name}` makes a new pair" in str(found.value)
                keys.renew(place, [name], ["10.0.0.9"], 30)
        with suppress(keys.KeysExist):
            keys.make(place, [1], [], 30)
        for name in (PLANT, MONITOR, "robot-1"):
            Credentials(place, name)
    assert halves == [*range(9)]


def test_a_lost_private_key_leads_to_no_pair_that_does_not_match(folder):
    (folder / "robot-3-key.pem").unlink()
    certificate = (folder / "robot-3.pem").read_bytes()
    with pytest.raises(Unusable, match=r"has robot-3.pem and not the other file of robot-3"):
        keys.make(folder, range(1, 6), [], 30)
    assert (folder / "robot-3.pem").read_bytes() == certificate
    assert not (folder / "robot-3-key.pem").exists()
    assert formnet("keys", "renew", folder, "robot-3")[0] == 0
    Credentials(folder, "robot-3")
    assert Generations.read(folder).admitted("robot-3") == "robot-3.2"


def test_keys_that_were_deleted_are_made_with_the_next_generation(folder):
    for end in (".pem", "-key.pem"):
        (folder / f"robot-3{end}").unlink()
    keys.make(folder, range(1, 6), [], 30)
    assert Generations.read(folder).admitted("robot-3") == "robot-3.2"  # a copy counts no more


def test_an_authority_s_certificate_is_not_made_again(folder):
    (folder / "ca.pem").unlink()
    code, said = formnet("keys", "init", folder, "--robots", "1-6")
    assert code == 2
    assert "ca.pem is missing: copy it back from any host" in said
    (folder / "ca-key.pem").unlink()
    code, said = formnet("keys", "init", folder, "--robots", "1-6")
    assert code == 2
    assert "and neither ca.pem nor ca-key.pem" in said


# --- renewed and revoked ---------------------------------------------------------------------


def test_a_renewal_replaces_one_pair_and_keeps_where_the_plant_is(folder):
    before = contents(folder)
    code, said = formnet("keys", "renew", folder, PLANT, "robot-2", "--days", "3")
    assert code == 0
    assert "plant.2: " in said
    assert "robot-2.2: " in said
    after = contents(folder)
    changed = {"plant.pem", "plant-key.pem", "robot-2.pem", "robot-2-key.pem", "generations.json"}
    assert {name for name in before if before[name] != after[name]} == changed
    assert after.keys() == before.keys()
    assert stat.S_IMODE((folder / "robot-2-key.pem").stat().st_mode) == 0o600
    assert served(folder) == {"localhost", "lab-pc", "127.0.0.1", "::1", "10.1.2.3"}
    for name in (PLANT, MONITOR, "robot-2"):
        Credentials(folder, name)
    assert formnet("keys", "renew", folder, PLANT, "--hosts", "other")[0] == 0
    assert served(folder) == {"localhost", "127.0.0.1", "::1", "other"}


def test_a_renewal_that_finds_no_room_changes_nothing(folder, monkeypatch):
    before, real, parts = contents(folder), keys.files._created, []

    def full(path, mode):
        parts.append(path)
        if len(parts) == 3:
            raise OSError(28, "No space left on device")
        return real(path, mode)

    monkeypatch.setattr(keys.files, "_created", full)
    code, said = formnet("keys", "renew", folder, "robot-2")
    assert code == 3
    assert "No space left on device" in said
    assert contents(folder) == before


def test_a_folder_of_the_version_before_says_what_to_do(folder):
    """Its certificates have no generation, and nothing says which count."""
    signer = authority.Authority.read(folder)
    for name in (PLANT, MONITOR, *map(robot_name, range(1, 6))):
        pair = signer.issue(name, name, ["localhost", "lab-pc"] if name == PLANT else [], 365)
        (folder / f"{name}-key.pem").write_bytes(pair.private_key)
        (folder / f"{name}.pem").write_bytes(pair.certificate)
    (folder / "generations.json").unlink()
    with pytest.raises(KeysError, match="by an earlier version and has no generation"):
        Credentials(folder, "robot-1")
    for command in (
        ("keys", "init", folder, "--robots", "1-6"),
        ("run", SCENARIO, "--keys", folder),
        ("doctor", "--keys", folder),
    ):
        code, said = formnet(*command)
        assert code > 1
        assert "earlier version" in said
        assert "`formnet keys renew " in said
    assert formnet("keys", "renew", folder)[0] == 0
    for name in (PLANT, MONITOR, *map(robot_name, range(1, 6))):
        Credentials(folder, name)
    assert "lab-pc" in served(folder)
    assert formnet("keys", "init", folder, "--robots", "1-6")[0] == 0


def test_what_cannot_be_revoked_or_renewed_is_said(folder):
    before = contents(folder)
    for words, command in [
        ("plant cannot be revoked: robots accept every plant's", ("revoke", folder, "plant")),
        ("has no certificate of 'robot-9'", ("revoke", folder, "robot-3", "robot-9")),
        ("has no certificate of '../x'", ("renew", folder, "../x")),
        ("has no certificate of 'ca'", ("renew", folder, "ca")),
        ("cannot be used: No such file or directory", ("revoke", folder / "none", "robot-3")),
    ]:
        code, said = formnet("keys", *command)
        assert code == 2
        assert words in said
    assert contents(folder) == before
    (folder / "ca-key.pem").unlink()  # as on the plant's machine
    assert formnet("keys", "renew", folder, "robot-3")[0] == 2
    assert formnet("keys", "revoke", folder, "robot-3")[0] == 0
    assert formnet("keys", "revoke", folder, "robot-3")[0] == 0
    assert json.loads((folder / "generations.json").read_text())["revoked"] == ["robot-3"]
    code, said = formnet("run", SCENARIO, "--keys", folder)
    assert code == 2
    assert "robot-3.pem (robot-3.1) is revoked or was renewed: where ca-key.pem is" in said


def test_no_certificate_outlives_its_authority(folder, monkeypatch):
    monkeypatch.setattr(authority, "AUTHORITY_DAYS", 5)
    place = folder.parent / "short"
    keys.make(place, [1], [], 30)
    code, said = formnet("doctor", "--keys", place)
    assert code == 0, said
    assert "! here: certificate of robot-1: robot-1.1, valid until " in said
    assert "its authority ends then: make a new one in another folder" in said


def test_the_doctor_warns_of_certificates_that_end_soon(folder):
    keys.renew(folder, ["robot-2"], [], 3)
    code, said = formnet("doctor", "--keys", folder)
    assert code == 0, said
    assert said.count("!") == 1
    assert "! here: certificate of robot-2: robot-2.2, valid until " in said
    assert "`formnet keys renew DIR robot-2`" in said


def test_certificates_live_for_30_days_unless_it_is_said(tmp_path):
    for days, options in [(30, ()), (2, ("--days", "2"))]:
        place = tmp_path / str(days)
        assert formnet("keys", "init", place, "--robots", "1", *options)[0] == 0
        found = x509.load_pem_x509_certificate((place / "robot-1.pem").read_bytes())
        left = found.not_valid_after_utc - datetime.now(UTC)
        assert timedelta(days=days - 1) < left <= timedelta(days=days)


@pytest.mark.parametrize("generation", [10**9 - 2, 10**9 - 1, 10**9])
def test_after_the_last_generation_there_is_none(folder, generation):
    file = folder / "generations.json"
    counting = json.loads(file.read_text())
    counting["issued"]["robot-1"] = generation
    file.write_text(json.dumps(counting))
    before = contents(folder)
    code, said = formnet("keys", "renew", folder, "robot-1")
    if generation == 10**9 - 2:
        assert code == 0, said
        Credentials(folder, "robot-1")
        return
    assert code == 2
    last = "robot-1 has had generation 999999999, the last that there is: make a new authority"
    assert (last if generation < 10**9 else "generations.json cannot be read") in said
    assert contents(folder) == before
