"""What stands before the addresses: the path of a proxy, and the size of bodies."""

from starlette.exceptions import HTTPException

from dldsim.app.web.api import answers
from dldsim.app.web.api.problems import PREFIX, answer, route_of
from dldsim.app.web.api.settings import Settings


class Prefix:
    """Tell the application the path of a proxy before it, whether the proxy strips that or not."""

    def __init__(self, app, root_path: str):
        self.app, self.root_path = app, root_path

    async def __call__(self, scope, receive, send):
        if scope["type"] == "http" and self.root_path:
            path = scope["path"]
            if not f"{path}/".startswith(f"{self.root_path}/"):
                path = self.root_path + path
            scope = {**scope, "root_path": self.root_path, "path": path}
        await self.app(scope, receive, send)


class BodyLimit:
    """Refuse a body that is too large, also one that does not tell its size beforehand."""

    def __init__(self, app, settings: Settings):
        self.app, self.settings = app, settings

    async def __call__(self, scope, receive, send):
        if scope["type"] != "http":
            return await self.app(scope, receive, send)
        upload = route_of(scope) == f"{PREFIX}/campaigns"
        most = self.settings.upload_max_bytes if upload else self.settings.body_max_bytes
        message = f"The body is larger than the {most} bytes that this service takes."
        given = dict(scope["headers"]).get(b"content-length", b"0")
        if not given.isdigit() or int(given) > most:
            refused = answer(413, answers.Problem(error="too-large", message=message))
            return await refused(scope, receive, send)
        seen = 0

        async def counted():
            nonlocal seen
            part = await receive()
            seen += len(part.get("body", b""))
            if seen > most:
                raise HTTPException(413, message)
            return part

        async def guarded(part):
            if part["type"] == "http.response.start":
                part["headers"] = [
                    *part.get("headers", []),
                    (b"x-content-type-options", b"nosniff"),
                ]
            await send(part)

        await self.app(scope, counted, guarded)
