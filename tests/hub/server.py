"""A local stand-in for the parts of the Hugging Face Hub that its client uses: repositories, commits, LFS.

The paths and fields are those that the client asks for and reads (huggingface_hub 2.4: `hf_api.py`,
`_commit_api.py`, `lfs.py`, `file_download.py`).
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
import re
import threading
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import unquote, urlsplit

import yaml

TOKEN = "hf_of_a_test"
LARGE = (".onnx", ".npz", ".mcap")
"""Suffixes of files that go to large-file storage, as in the Hub's own .gitattributes."""
LICENCES = ("apache-2.0", "mit", "cc0-1.0", "cc-by-4.0", "other")
"""Licences of the Hub's list (https://huggingface.co/docs/hub/repositories-licenses)."""

_REPO = r"(?P<kind>model|dataset)s/(?P<repo>[^/]+/[^/]+)"
_FILE = r"/(?P<prefix>datasets/)?(?P<repo>[^/]+/[^/]+)"


def git_blob(data):
    return hashlib.sha1(b"blob %d\0" % len(data) + data).hexdigest()


def pointer(data):
    """Return the Git LFS pointer that Git stores in place of a large file."""
    oid = hashlib.sha256(data).hexdigest()
    return f"version https://git-lfs.github.com/spec/v1\noid sha256:{oid}\nsize {len(data)}\n".encode()


@dataclass
class Repo:
    private: bool = False
    commits: dict = field(default_factory=dict)
    """The files of each commit by its hash: their bytes by path."""
    refs: dict = field(default_factory=dict)
    messages: list = field(default_factory=list)

    def commit(self, files, message="", ref="main"):
        """Make a commit of these files on top of a branch, and return its hash."""
        whole = self.files(ref) | files
        made = hashlib.sha1(repr((sorted(whole.items()), len(self.messages))).encode()).hexdigest()
        self.commits[made] = whole
        self.refs[ref] = made
        self.messages.append(message)
        return made

    def files(self, revision):
        return self.commits.get(self.refs.get(revision, revision), {})

    def resolve(self, revision):
        found = self.refs.get(revision, revision)
        return found if found in self.commits else None


class Hub:
    """The repositories of the Hub, and the requests so far."""

    def __init__(self):
        self.repos = {}
        self.asked = []
        """(method, path) of each request."""
        self.stored = {}
        self.down = False
        """The Hub answers 503 to everything."""
        self.mangled = set()
        """Paths of files that are sent with a wrong last byte."""

    def add(self, repo, files, *, kind="model", private=False):
        """Add a repository with one commit, and return that commit."""
        made = self.repos.setdefault((kind, repo), Repo(private=private))
        return made.commit(files)


class _Handler(BaseHTTPRequestHandler):
    hub: Hub
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def do_GET(self):
        self.answer()

    do_HEAD = do_POST = do_PUT = do_GET

    def answer(self):
        path = unquote(urlsplit(self.path).path)
        self.hub.asked.append((self.command, path))
        self.body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        self.allowed = self.headers.get("Authorization") == f"Bearer {TOKEN}"
        if self.hub.down:
            self.say(503, b"")
            return
        for pattern, method in self.ROUTES:
            if found := re.fullmatch(pattern, path):
                getattr(self, method)(**found.groupdict())
                return
        self.say(404, b"")

    ROUTES = (
        (r"/api/repos/create", "create"),
        (r"/api/validate-yaml", "validate"),
        (rf"/api/{_REPO}(?:/revision/(?P<revision>.+))?", "info"),
        (rf"/api/{_REPO}/tree/(?P<revision>.+)", "tree"),
        (rf"/api/{_REPO}/preupload/(?P<revision>.+)", "preupload"),
        (rf"/api/{_REPO}/commit/(?P<revision>.+)", "commit"),
        (rf"{_FILE}\.git/info/lfs/objects/batch", "batch"),
        (r"/lfs/(?P<oid>[0-9a-f]{64})", "large"),
        (rf"{_FILE}/resolve/(?P<revision>[^/]+)/(?P<path>.+)", "resolve"),
    )

    def say(self, status, body, **headers):
        if not isinstance(body, bytes):
            body = json.dumps(body).encode()
        self.send_response(status)
        for name, value in ({"Content-Length": len(body)} | headers).items():
            self.send_header(name.replace("_", "-"), str(value))
        self.end_headers()
        if self.command != "HEAD":
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                self.wfile.write(body)

    def found(self, kind, repo, revision="main"):
        """Return a repository and a commit of it, or refuse as the Hub does."""
        held = self.hub.repos.get((kind, repo))
        if held is None or (held.private and not self.allowed):
            self.say(401, {"error": "Repository not found"}, X_Error_Code="RepoNotFound")
            return None, None
        if held.commits and held.resolve(revision) is None:
            self.say(404, {"error": "Invalid rev id"}, X_Error_Code="RevisionNotFound")
            return None, None
        return held, held.resolve(revision)

    def may_write(self):
        if not self.allowed:
            self.say(401, {"error": "Invalid username or password."})
        return self.allowed

    def create(self):
        asked = json.loads(self.body)
        if not self.may_write():
            return
        repo, kind = f"{asked['organization']}/{asked['name']}", asked.get("type", "model")
        if (kind, repo) in self.hub.repos:
            self.say(409, {"error": "You already created this repo", "url": self.url(kind, repo)})
            return
        made = self.hub.repos[kind, repo] = Repo(private=asked.get("visibility") == "private")
        made.commit({".gitattributes": b"".join(b"*%s filter=lfs\n" % end.encode() for end in LARGE)})
        self.say(200, {"url": self.url(kind, repo)})

    def url(self, kind, repo):
        host, port = self.server.server_address[:2]
        return f"http://{host}:{port}/{'datasets/' if kind == 'dataset' else ''}{repo}"

    def validate(self):
        """Refuse a card whose header the Hub would refuse."""
        found = re.match(r"---\n(.*?)\n---\n", json.loads(self.body)["content"], re.DOTALL)
        header = yaml.safe_load(found[1]) if found else None
        if not isinstance(header, dict) or header.get("license", "other") not in LICENCES:
            self.say(400, {"errors": [{"message": "license must be one of the list"}], "warnings": []})
            return
        self.say(200, {"errors": [], "warnings": []})

    def info(self, kind, repo, revision):
        held, commit = self.found(kind, repo, revision or "main")
        if held is not None:
            siblings = [{"rfilename": path} for path in held.files(commit)]
            self.say(200, {"id": repo, "sha": commit, "private": held.private, "siblings": siblings})

    def tree(self, kind, repo, revision):
        held, commit = self.found(kind, repo, revision)
        if held is None:
            return
        listed = []
        for path, data in held.files(commit).items():
            entry = {"type": "file", "path": path, "size": len(data), "oid": git_blob(data)}
            if path.endswith(LARGE):
                oid, text = hashlib.sha256(data).hexdigest(), pointer(data)
                lfs = {"oid": oid, "size": len(data), "pointerSize": len(text)}
                entry |= {"oid": git_blob(text), "lfs": lfs}
            listed.append(entry)
        self.say(200, listed)

    def resolve(self, prefix, repo, revision, path):
        held, commit = self.found("dataset" if prefix else "model", repo, revision)
        if held is None:
            return
        data = held.files(commit).get(path)
        if data is None:
            self.say(404, b"", X_Error_Code="EntryNotFound", X_Repo_Commit=commit)
            return
        sent = data[:-1] + bytes([data[-1] ^ 1]) if path in self.hub.mangled else data
        if path.endswith(LARGE):
            oid = hashlib.sha256(data).hexdigest()
            self.hub.stored[oid] = sent
            linked = {"X_Linked_Etag": f'"{oid}"', "X_Linked_Size": len(data)}
            there = f"http://localhost:{self.server.server_address[1]}/lfs/{oid}"  # another host, as a CDN is
            self.say(302, b"", Location=there, X_Repo_Commit=commit, **linked)
            return
        self.say(200, sent, ETag=f'"{git_blob(data)}"', X_Repo_Commit=commit)

    def preupload(self, kind, repo, revision):
        held, commit = self.found(kind, repo, revision)
        if held is None or not self.may_write():
            return
        there = held.files(commit)
        files = [
            {
                "path": file["path"],
                "uploadMode": "lfs" if file["path"].endswith(LARGE) else "regular",
                "shouldIgnore": False,
                "oid": self.oid(file["path"], there),
            }
            for file in json.loads(self.body)["files"]
        ]
        self.say(200, {"files": files})

    @staticmethod
    def oid(path, there):
        if path not in there:
            return None
        data = there[path]
        return hashlib.sha256(data).hexdigest() if path.endswith(LARGE) else git_blob(data)

    def batch(self, prefix, repo):
        if not self.may_write():
            return
        host, port = self.server.server_address[:2]
        objects = [
            wanted
            if wanted["oid"] in self.hub.stored
            else wanted | {"actions": {"upload": {"href": f"http://{host}:{port}/lfs/{wanted['oid']}"}}}
            for wanted in json.loads(self.body)["objects"]
        ]
        self.say(200, {"transfer": "basic", "objects": objects})

    def large(self, oid):
        if self.command == "PUT":
            right = hashlib.sha256(self.body).hexdigest() == oid
            if right:
                self.hub.stored[oid] = self.body
            self.say(200 if right else 400, b"")
        else:
            data = self.hub.stored.get(oid)
            self.say(404 if data is None else 200, data or b"", ETag=f'"{oid}"')

    def commit(self, kind, repo, revision):
        held, _ = self.found(kind, repo, revision)
        if held is None or not self.may_write():
            return
        files, message = {}, ""
        for line in self.body.splitlines():
            entry = json.loads(line)
            value = entry["value"]
            if entry["key"] == "header":
                message = value["summary"]
            elif entry["key"] == "file":
                files[value["path"]] = base64.b64decode(value["content"])
            elif entry["key"] == "lfsFile":
                files[value["path"]] = self.hub.stored[value["oid"]]
        made = held.commit(files, message, revision)
        self.say(200, {"commitUrl": f"{self.url(kind, repo)}/commit/{made}", "commitOid": made})


@contextlib.contextmanager
def serving(hub):
    """Serve a hub on a free port of this machine; give its address."""
    handler = type("Handler", (_Handler,), {"hub": hub})
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        server.daemon_threads = True
        thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
        thread.start()
        yield "http://{}:{}".format(*server.server_address[:2])
        server.shutdown()
        thread.join(10)
