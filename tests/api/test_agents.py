"""Agents over HTTP, with the client of the package `mcp`: who is known by which token."""

import asyncio
import json
from contextlib import asynccontextmanager

import httpx2
import pytest
from mcp import Client
from mcp.client.streamable_http import streamable_http_client
from mcp.shared.exceptions import MCPError

from gcs_server.agents.answers import UNTRUSTED
from gcs_server.app import create_app
from gcs_server.errors import InvalidRequest
from gcs_server.settings import Settings, load

URL = "http://localhost"


def token(folder):
    return (folder / "agents" / "helper.token").read_text().strip()


def run_with_server(folder, scenario, **settings):
    """Runs a scenario with the application of a server that knows one agent."""
    chosen = {"port": 0, "links": (), "sim": 0, "data": folder, "scene": False, "record": False}
    app = create_app(Settings(**{**chosen, "agents": ("helper=plan",), **settings}), static=folder / "none")

    async def run():
        async with app.router.lifespan_context(app):
            async with asyncio.timeout(60):
                await scenario(app)

    asyncio.run(run())


def http_client(app, sent=None):
    headers = {} if sent is None else {"Authorization": f"Bearer {sent}"}
    return httpx2.AsyncClient(transport=httpx2.ASGITransport(app), base_url=URL, headers=headers)


@asynccontextmanager
async def agent(app, sent=None, mode="auto"):
    async with (
        http_client(app, sent) as http,
        Client(streamable_http_client(f"{URL}/mcp", http_client=http), mode=mode) as client,
    ):
        yield client


async def call(client, tool, /, **arguments):
    result = await client.call_tool(tool, arguments)
    return json.loads(result.content[0].text)[UNTRUSTED]


async def names_of(client):
    return {tool.name for tool in (await client.list_tools()).tools}


@pytest.mark.parametrize("mode", ["auto", "legacy"])
def test_an_agent_has_the_tools_of_its_scope_and_without_its_token_only_reads(tmp_path, mode):
    async def scenario(app):
        async with agent(app, mode=mode) as unnamed, agent(app, token(tmp_path), mode) as helper:
            assert "untrusted_data" in unnamed.instructions
            assert {"read_vehicles", "wait"} <= await names_of(unnamed)
            assert not {"plans_create", "takeoff"} & await names_of(unnamed)
            assert "plans_create" in await names_of(helper)
            assert "takeoff" not in await names_of(helper)
            example = json.loads((await helper.list_tools()).model_dump_json())["tools"]
            (plans_create,) = [each for each in example if each["name"] == "plans_create"]
            text = plans_create["input_schema"]["properties"]["plan"]["description"]
            plan = json.loads(text.partition("A short plan: ")[2])
            created = await call(helper, "plans_create", name="round", plan=plan)
            assert created["changed_by"] == "agent helper"
            assert (
                "needs the scope 'plan'" in (await call(unnamed, "plans_create", name="x", plan=plan))["why"]
            )
            assert [each["name"] for each in (await call(unnamed, "read_plans"))["plans"]] == ["round"]

    run_with_server(tmp_path, scenario)


def test_resources_are_vehicles_plans_journal_and_documents(tmp_path):
    async def scenario(app):
        async with agent(app) as client:
            uris = [str(each.uri) for each in (await client.list_resources()).resources]
            texts = {uri: (await client.read_resource(uri)).contents[0].text for uri in uris}
            assert "gcs://docs/agents" in uris
            assert "simulated" in texts["gcs://docs/agents"]
            assert json.loads(texts["gcs://docs/plans"])["$defs"]["Takeoff"]
            journal = (await client.read_resource("gcs://journal")).contents[0].text
            commands = {each["command"] for each in json.loads(journal)[UNTRUSTED]["entries"]}
            assert {"agents/read_vehicles", "agents/read_plans", "agents/read_document"} <= commands
            with pytest.raises(MCPError, match=r"no such resource\. Accepted: gcs://vehicles"):
                await client.read_resource("gcs://docs/../journal.jsonl")

    run_with_server(tmp_path, scenario)


def test_the_token_of_an_agent_opens_only_the_agents_path(tmp_path):
    async def scenario(app):
        async with http_client(app, token(tmp_path)) as http:
            for method, path in (
                ("GET", "/api/v1/vehicles"),
                ("POST", "/api/v1/vehicles/1/arm"),
                ("GET", "/"),
            ):
                answer = await http.request(method, path)
                assert (answer.status_code, answer.json()["code"]) == (403, "agent_token")
        async with http_client(app, "mistyped") as http:
            assert (await http.post("/mcp", json={})).json()["code"] == "token_wrong"
        async with http_client(app) as http:
            foreign = await http.post("/mcp", json={}, headers={"Origin": "http://evil.example"})
            assert foreign.json()["code"] == "foreign_origin"
            agents = (await http.get("/api/v1/agents")).json()["agents"]
            assert [(each["name"], each["scope"], each["calls"]) for each in agents] == [
                ("helper", "plan", 0)
            ]
            assert token(tmp_path) not in (await http.get("/api/v1/agents")).text

    run_with_server(tmp_path, scenario)


def test_a_server_with_a_token_admits_agents_by_their_own(tmp_path):
    async def scenario(app):
        async with http_client(app) as http:
            assert (await http.post("/mcp", json={})).status_code == 401
        async with agent(app, token(tmp_path)) as helper:
            assert await call(helper, "read_vehicles") == []
            assert "plans_create" in await names_of(helper)
        async with agent(app, "a-token-of-the-server") as reader:
            assert "plans_create" not in await names_of(reader)

    run_with_server(tmp_path, scenario, host="0.0.0.0", token="a-token-of-the-server")


@pytest.mark.parametrize("text", ["helper", "helper=pilot", "He lper=read", "=read", "../x=read"])
def test_an_agent_without_a_name_or_a_known_scope_stops_the_start(text):
    with pytest.raises(InvalidRequest, match="an agent is name=scope"):
        load({"agents": (text,)}, {})


def test_two_agents_do_not_have_one_name():
    with pytest.raises(InvalidRequest, match="the same name"):
        load({}, {"GCS_AGENTS": "a=read,a=fly"})
