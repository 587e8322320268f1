"""Keys of others, or that others can read or change, or that do not match, are not used."""

import os
import shutil

import pytest
from in_process import formnet

from formnet.formation.machines.custody import KeysError
from formnet.formation.wire.security import Credentials
from formnet.lab.machines import authority, keys
from formnet.lab.machines.keys import Unusable
from formnet.lab.scenarios.packaged import CONFIGS

OTHER_USER = 12345
SCENARIO = CONFIGS / "paper" / "section5-delay.toml"


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


# --- whose it is -----------------------------------------------------------------------------


def readable(folder):
    (folder / "robot-1-key.pem").chmod(0o640)


def authority_readable(folder):
    (folder / "ca-key.pem").chmod(0o644)


def authority_writable(folder):
    (folder / "ca.pem").chmod(0o666)


def counting_writable(folder):
    (folder / "generations.json").chmod(0o664)


def folder_writable(folder):
    folder.chmod(0o777)


def parent_writable(folder):
    folder.parent.chmod(0o777)


def folder_of_another(folder):
    os.chown(folder, OTHER_USER, -1)


def authority_of_another(folder):
    os.chown(folder / "ca-key.pem", OTHER_USER, -1)


def key_of_another(folder):
    os.chown(folder / "plant-key.pem", OTHER_USER, -1)


def linked_key(folder):
    (folder / "robot-1-key.pem").rename(folder.parent / "elsewhere.pem")
    (folder / "robot-1-key.pem").symlink_to(folder.parent / "elsewhere.pem")


def linked_authority(folder):
    (folder / "ca.pem").rename(folder.parent / "elsewhere.pem")
    (folder / "ca.pem").symlink_to(folder.parent / "elsewhere.pem")


def dangling_key(folder):
    (folder / "robot-1-key.pem").unlink()
    (folder / "robot-1-key.pem").symlink_to(folder.parent / "new.pem")


def piped_key(folder):
    (folder / "robot-1-key.pem").unlink()
    os.mkfifo(folder / "robot-1-key.pem", 0o600)


def swapped_key(folder):
    shutil.copy(folder / "robot-2-key.pem", folder / "robot-1-key.pem")


def swapped_pair(folder):
    for end in (".pem", "-key.pem"):
        shutil.copy(folder / f"robot-2{end}", folder / f"robot-1{end}")


def other_authority(folder):
    keys.make(folder.parent / "other", [1], [], 30)
    for end in (".pem", "-key.pem"):
        shutil.copy(folder.parent / "other" / f"robot-1{end}", folder / f"robot-1{end}")


def other_authority_key(folder):
    keys.make(folder.parent / "other", [1], [], 30)
    shutil.copy(folder.parent / "other" / "ca-key.pem", folder / "ca-key.pem")


def no_key(folder):
    (folder / "robot-1-key.pem").unlink()


def no_certificate(folder):
    (folder / "robot-1.pem").unlink()


def half_written(folder):
    (folder / "robot-1.pem").write_bytes((folder / "robot-1.pem").read_bytes()[:200])


def encrypted(folder):
    key = authority.serialization.load_pem_private_key(
        (folder / "robot-1-key.pem").read_bytes(), None
    )
    sealed = key.private_bytes(
        authority.serialization.Encoding.PEM,
        authority.serialization.PrivateFormat.PKCS8,
        authority.serialization.BestAvailableEncryption(b"secret"),
    )
    (folder / "robot-1-key.pem").write_bytes(sealed)


def no_generations(folder):
    (folder / "generations.json").unlink()


def odd_generations(folder):
    (folder / "generations.json").write_text('{"issued": {"robot-1": 1, "../x": 1}}')


SPOILT = [
    (readable, "robot-1-key.pem can be read by others"),
    (authority_readable, "ca-key.pem can be read by others"),
    (authority_writable, "ca.pem can be changed by others"),
    (counting_writable, "generations.json can be changed by others"),
    (folder_writable, "is a folder into which others may write"),
    (parent_writable, "lies below a folder into which others may write"),
    (folder_of_another, "belongs to another user (uid 12345)"),
    (authority_of_another, "ca-key.pem belongs to another user (uid 12345)"),
    (key_of_another, "plant-key.pem belongs to another user (uid 12345)"),
    (linked_key, "robot-1-key.pem is a link or no regular file"),
    (linked_authority, "ca.pem is a link or no regular file"),
    (dangling_key, "robot-1-key.pem is a link or no regular file"),
    (piped_key, "robot-1-key.pem is a link or no regular file"),
    (swapped_key, "robot-1-key.pem is not the private key of robot-1.pem"),
    (swapped_pair, "robot-1.pem is of 'robot-2.1'"),
    (other_authority, "robot-1.pem is not of this ca.pem"),
    (other_authority_key, "ca-key.pem is not the private key of ca.pem"),
    (no_key, "robot-1"),
    (no_certificate, "robot-1"),
    (half_written, "robot-1.pem and robot-1-key.pem are no certificate with its key"),
    (encrypted, "robot-1.pem and robot-1-key.pem are no certificate with its key"),
    (no_generations, "generations.json is missing"),
    (odd_generations, "generations.json cannot be read: its format is unknown"),
]


@pytest.mark.parametrize(("spoil", "words"), SPOILT, ids=[spoil.__name__ for spoil, _ in SPOILT])
def test_keys_are_looked_at_before_they_are_used(folder, tmp_path, spoil, words):
    """By ``keys init``, ``run`` and ``doctor``, which say the remedy, and change nothing."""
    spoil(folder)
    before, there = contents(folder) if spoil is not piped_key else None, set(tmp_path.iterdir())
    for command in (
        ("keys", "init", folder, "--robots", "1-6"),
        ("run", SCENARIO, "--keys", folder, "--out", tmp_path / "run"),
        ("doctor", "--keys", folder),
    ):
        code, said = formnet(*command)
        assert code == (3 if command[0] == "doctor" else 2), said
        assert words in said
        assert "formnet keys" in said or "chmod" in said or "copy" in said or "yours" in said
    assert before is None or contents(folder) == before
    assert set(tmp_path.iterdir()) == there


def test_a_folder_below_one_that_all_may_write_is_not_made(tmp_path):
    open_ = tmp_path / "open"
    open_.mkdir()
    open_.chmod(0o777)
    code, said = formnet("keys", "init", open_ / "keys", "--robots", "1")
    assert code == 2
    assert f"into which others may write ({open_})" in said
    assert list(open_.iterdir()) == []
    open_.chmod(0o1777)  # as /tmp: nobody else can replace what is one's own
    assert formnet("keys", "init", open_ / "keys", "--robots", "1")[0] == 0


def test_a_link_where_a_key_is_to_be_written_is_not_followed(tmp_path):
    place = tmp_path / "keys"
    place.mkdir(mode=0o700)
    (tmp_path / "precious").write_text("precious")
    for name in ("ca-key.pem", "generations.json", "robot-1-key.pem"):
        (place / name).symlink_to(tmp_path / "precious")
        code, _ = formnet("keys", "init", place, "--robots", "1")
        assert code == 2
        assert (tmp_path / "precious").read_text() == "precious"
        assert [path.name for path in place.iterdir()] == [name]
        (place / name).unlink()


@pytest.mark.parametrize("name", ["ca.pem", "ca-key.pem", "robot-1.pem", "robot-1-key.pem"])
def test_a_key_or_certificate_that_is_long_is_not_read(folder, name):
    """Sparse files, which take no room: reading one took eight gigabytes of memory."""
    with (folder / name).open("ab") as file:
        file.truncate(2**40)
    with pytest.raises(KeysError, match=f"{name} is longer than 65536 bytes"):
        Credentials(folder, "robot-1")
    if name.startswith("ca"):
        with pytest.raises(Unusable, match=f"{name} is longer than 65536 bytes"):
            keys.renew(folder, ["robot-1"], [], 1)
    else:
        keys.renew(folder, ["robot-1"], [], 1)
        assert Credentials(folder, "robot-1").generations().issued["robot-1"] == 2


def test_a_plant_s_certificate_that_is_long_says_nothing_of_where_it_is(folder):
    with (folder / "plant.pem").open("ab") as file:
        file.truncate(2**40)
    with pytest.raises(Unusable, match="does not say where the plant may be reached"):
        keys.renew(folder, ["plant"], [], 1)
