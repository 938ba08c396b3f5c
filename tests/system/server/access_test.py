"""Who is let in: certificates that are replaced while the server runs, tokens, their files."""

import pathlib
import shutil
import sys
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import fovead  # noqa: E402
import support  # noqa: E402
from fovead import eventually  # noqa: E402

BOTH = ["ball", "lab/ball"]


class Certificates(fovead.FoveadTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.old = fovead.make_authority(cls.folder, "old")
        cls.new = fovead.make_authority(cls.folder, "new")
        cls.certificate, cls.key = cls.folder / "now.crt", cls.folder / "now.key"
        for name in ("old", "new"):
            fovead.make_certificate(cls.folder, f"server-{name}", cls.folder / f"{name}.crt")

    def put(self, name):
        """The certificate in use becomes NAME's, as tools do it: one file after the other."""
        shutil.copy(self.folder / f"server-{name}.crt", self.certificate)
        shutil.copy(self.folder / f"server-{name}.key", self.key)

    def serve_tls(self, *flags):
        self.put("old")
        return self.serve("--tls-cert", self.certificate, "--tls-key", self.key, *flags)

    def ask(self, server, authority, *flags):
        return support.run("info", "--server", server.address, "--tls-ca", authority, *flags)

    def answers(self, server, authority, *flags):
        return self.ask(server, authority, *flags).returncode == 0

    def test_garbage_changes_nothing_and_a_good_one_is_taken(self):
        with self.serve_tls() as server:
            self.assertEqual(self.names(server, "--tls-ca", self.old), BOTH)
            self.assertFalse(self.answers(server, self.new))
            for number, (path, text) in enumerate((
                    (self.certificate, "garbage"), (self.certificate, ""), (self.key, "garbage"),
                    (self.key, (self.folder / "server-new.key").read_text(encoding="utf-8")))):
                self.put("old")
                path.write_text(text, encoding="utf-8")
                eventually(lambda: server.log().count("stays in use") > number)
                self.assertEqual(self.names(server, "--tls-ca", self.old), BOTH, path)
            self.put("old")
            self.certificate.unlink()
            self.assertEqual(self.names(server, "--tls-ca", self.old), BOTH)
            self.put("new")
            eventually(lambda: self.answers(server, self.new))
            self.assertFalse(self.answers(server, self.old))

    def test_an_expired_one_is_not_taken(self):
        fovead.make_certificate(self.folder, "server-past", self.old, days=-1)
        with self.serve_tls() as server:
            self.put("past")
            eventually(lambda: "has expired" in server.log())
            self.assertTrue(self.answers(server, self.old))
        result = support.run("serve", self.root, "--listen", "127.0.0.1:0", "--tls-cert",
                             self.certificate, "--tls-key", self.key)
        self.assertEqual(result.returncode, 2)
        self.assertIn("--tls-cert", result.stderr)
        self.assertIn("has expired", result.stderr)

    def test_plaintext_and_other_authorities_are_refused(self):
        with self.serve_tls() as server:
            self.refused(1, "info", "--server", server.address,
                         says=[server.address, "--tls-ca is needed here"])
            result = self.ask(server, self.new)
            self.assertEqual(result.returncode, 1)
            self.assertTrue(result.stderr.startswith("fovea: server " + server.address))
            self.assertIn("--tls-ca: it does not hold the authority", result.stderr)
            self.refused(1, "info", "--server", f"localhost:{server.port}", "--tls-ca", self.old,
                         says=["--server: give a name that the server's certificate is for"])
        with self.serve() as server:
            self.refused(1, "info", "--server", server.address, "--tls-ca", self.old,
                         says=["--tls-ca: this server has no TLS"])

    def test_clients_show_a_certificate_where_one_is_asked_for(self):
        certificate, key = fovead.make_certificate(self.folder, "me", self.new)
        stranger, its_key = fovead.make_certificate(self.folder, "stranger", self.old)
        with self.serve_tls("--tls-client-ca", self.new) as server:
            for flags in ((), ("--tls-cert", stranger, "--tls-key", its_key)):
                result = self.ask(server, self.old, *flags)
                self.assertEqual(result.returncode, 1)
                self.assertIn("--tls-cert and --tls-key, too", result.stderr)
            self.assertTrue(self.answers(server, self.old, "--tls-cert", certificate, "--tls-key",
                                         key))

    def test_other_addresses_need_tls_or_the_typed_word(self):
        listen = ("serve", self.root, "--listen", "0.0.0.0:0")
        for flags in ((), ("--tokens", self.folder / "none")):
            result = support.run(*listen, *flags)
            self.assertEqual(result.returncode, 2)
            self.assertIn("--tls-cert", result.stderr)
        self.put("old")
        with fovead.Fovead(self.root, self.folder / "serve.log", "--tls-cert", self.certificate,
                           "--tls-key", self.key, listen="0.0.0.0:0") as server:
            self.assertTrue(support.run("info", "--server", f"127.0.0.1:{server.port}", "--tls-ca",
                                        self.old).returncode == 0)
            self.assertIn("whoever reaches", server.log())


class Tokens(fovead.FoveadTest):
    def make(self, name, *flags):
        """A token's file, and the token."""
        made = self.fovea("token", name, "--tokens", self.folder / "tokens.json", *flags).stdout
        path = self.folder / f"{name}.token"
        path.write_text(made, encoding="utf-8")
        return path, made.strip()

    def setUp(self):
        (self.folder / "tokens.json").unlink(missing_ok=True)
        self.all, self.secret = self.make("all")
        self.lab, _ = self.make("lab", "--prefix", "lab", "--pixels-per-second", 8000)

    def test_each_sees_its_own_and_the_log_no_token(self):
        with self.serve("--tokens", self.folder / "tokens.json", "--log-level", "trace") as server:
            self.assertEqual(self.names(server, "--token-file", self.all), BOTH)
            self.assertEqual(self.names(server, "--token-file", self.lab), ["lab/ball"])
            ask = ("--server", server.address)
            self.refused(1, "info", *ask, says=["asks for a token", "--token-file"])
            self.refused(1, "info", *ask, "ball", "--token-file", self.lab, says=["no dataset"])
            wrong = self.folder / "wrong.token"
            wrong.write_text(self.secret[:-1] + "!\n", encoding="utf-8")
            message = self.refused(1, "info", *ask, "--token-file", wrong, says=["does not know"])
            self.assertNotIn(self.secret[:-1], message)
            self.assertNotIn(self.secret[6:20], server.log())
            self.assertNotIn("Bearer fovea_", server.log())

    def test_above_a_quota_calls_are_refused_and_say_until_when(self):
        with self.serve("--tokens", self.folder / "tokens.json") as server:
            def render():
                return support.run("render", "--server", server.address, "lab/ball", "--size",
                                   "64x64", "-o", self.folder / "f.png", "--token-file", self.lab)
            self.assertEqual(render().returncode, 0)
            result = render()  # 4,096 pixels each, 8,000 a second
            while result.returncode == 0:
                result = render()
            for text in ("token:lab", "8000 pixels a second", "try again in"):
                self.assertIn(text, result.stderr)

    def test_changes_count_at_once(self):
        with self.serve("--tokens", self.folder / "tokens.json") as server:
            more, _ = self.make("more")
            eventually(lambda: support.run("info", "--server", server.address, "--token-file",
                                           more).returncode == 0)
            (self.folder / "tokens.json").write_text("garbage", encoding="utf-8")
            eventually(lambda: "stay in force" in server.log())
            self.assertEqual(self.names(server, "--token-file", more), BOTH)

    def test_the_client_sends_no_token_in_plaintext_to_another_machine(self):
        self.refused(1, "info", "--server", "192.0.2.1:1", "--token-file", self.all,
                     says=["--token-file", "--tls-ca"])

    def test_a_token_is_made_once(self):
        self.refused(1, "token", "all", "--tokens", self.folder / "tokens.json",
                     says=["all", "already"])
        self.refused(2, "token", "a/b", "--tokens", self.folder / "tokens.json", says=["name"])
        text = (self.folder / "tokens.json").read_text(encoding="utf-8")
        self.assertNotIn(self.secret, text)


if __name__ == "__main__":
    unittest.main()
