"""Plans on disk: versions, conflicts, limits, and damaged files."""

import asyncio
import json
from types import SimpleNamespace

import pytest

from gcs_server.errors import PlanConflict, Refused, UnknownPlan
from gcs_server.plans import store as plan_store
from gcs_server.plans.store import PlanStore
from gcs_server.plans.tasks import ReadDocument
from gcs_server.storage.folder import StorageError
from gcs_server.vehicle.events import EventFeed
from missions import plan as plan_document
from missions.plan import Plan

ANNA, BOB = ("anna", "anna's tab"), ("bob", "bob's tab")


class Clock:
    """A clock that advances by one second at each reading."""

    def __init__(self):
        self.now_s = 1000.0

    def unix_s(self):
        self.now_s += 1.0
        return self.now_s


def plan(speed_m_s=5.0, item_count=1):
    item = {"kind": "return_home"}
    text = json.dumps({"hover_speed_m_s": speed_m_s, "items": [item] * item_count})
    return ReadDocument.of(Plan.model_validate_json(text))


def read_stored(text):
    return ReadDocument.of(plan_document.read(text))


def run_with_store(tmp_path, work):
    async def run():
        published, events = [], EventFeed()
        events.subscribe(published.append)
        store = PlanStore(tmp_path / "plans", Clock(), events)
        try:
            await work(SimpleNamespace(store=store, published=published, folder=tmp_path / "plans"))
        finally:
            store.close()

    asyncio.run(run())


def test_plans_and_versions_are_stored_across_a_restart(tmp_path):
    async def work(context):
        first = await context.store.create("Tower", plan(item_count=3), by=ANNA)
        assert (first.version, first.changed_by, first.item_count) == (1, "anna", 3)
        second = await context.store.save(first.id, "Old tower", plan(7.0), base_version=1, by=BOB)
        assert (second.id, second.name, second.version) == (first.id, "Old tower", 2)
        await context.store.create("barn", plan(), by=ANNA)
        reopened = PlanStore(context.folder, Clock(), EventFeed())
        assert [head.name for head in await reopened.all()] == ["barn", "Old tower"]
        assert [head.version for head in await reopened.versions(first.id)] == [2, 1]
        head, document = await reopened.get(first.id)
        assert (head, read_stored(document)) == (second, plan(7.0))
        head, document = await reopened.get(first.id, 1)
        assert (head, read_stored(document)) == (first, plan(item_count=3))
        reopened.close()

    run_with_store(tmp_path, work)


def test_a_save_based_on_an_older_version_is_refused_and_the_error_names_the_other_client(tmp_path):
    async def work(context):
        first = await context.store.create("Tower", plan(), by=ANNA)
        second = await context.store.save(first.id, "Tower", plan(6.0), base_version=1, by=BOB)
        for change in (
            context.store.save(first.id, "Tower", plan(9.0), base_version=1, by=ANNA),
            context.store.delete(first.id, base_version=1, by=ANNA),
        ):
            with pytest.raises(PlanConflict, match="version 2, saved by bob") as error:
                await change
            details = error.value.details()
            assert (details["version"], details["changed_unix_s"]) == (2, second.changed_unix_s)
        assert read_stored((await context.store.get(first.id))[1]) == plan(6.0)

    run_with_store(tmp_path, work)


def test_one_of_two_concurrent_saves_is_refused(tmp_path):
    async def work(context):
        first = await context.store.create("Tower", plan(), by=ANNA)
        saves = [
            context.store.save(first.id, "Tower", plan(speed_m_s), base_version=1, by=BOB)
            for speed_m_s in (2.0, 3.0)
        ]
        results = await asyncio.gather(*saves, return_exceptions=True)
        assert sorted(type(result).__name__ for result in results) == ["PlanConflict", "PlanVersion"]
        assert len(await context.store.versions(first.id)) == 2

    run_with_store(tmp_path, work)


def test_a_save_with_a_cancelled_caller_is_complete_or_absent(tmp_path):
    async def work(context):
        first = await context.store.create("Tower", plan(), by=ANNA)
        save_task = asyncio.ensure_future(
            context.store.save(first.id, "T", plan(2.0), base_version=1, by=BOB)
        )
        await asyncio.sleep(0)
        save_task.cancel()
        head, document = await context.store.get(first.id)  # waits for the save: one thread
        saved = head.version == 2
        assert read_stored(document) == (plan(2.0) if saved else plan())
        await context.store.all()
        assert [change.data["action"] for change in context.published] == ["created", "saved"][: head.version]

    run_with_store(tmp_path, work)


def test_every_change_is_published_with_its_client(tmp_path):
    async def work(context):
        first = await context.store.create("Tower", plan(), by=ANNA)
        await context.store.save(first.id, "Tower", plan(), base_version=1, by=BOB)
        await context.store.delete(first.id, base_version=2, by=ANNA)
        await context.store.all()
        assert [
            (each.data["action"], each.data["plan"]["version"], each.data["client"])
            for each in context.published
        ] == [
            ("created", 1, "anna"),
            ("saved", 2, "bob"),
            ("deleted", 2, "anna"),
        ]
        assert await context.store.all() == []
        assert list(context.folder.iterdir()) == []
        with pytest.raises(UnknownPlan):
            await context.store.get(first.id)

    run_with_store(tmp_path, work)


def test_only_the_newest_versions_are_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(plan_store, "MAX_VERSIONS", 3)

    async def work(context):
        head = await context.store.create("Tower", plan(), by=ANNA)
        for base_version in range(1, 6):
            head = await context.store.save(head.id, "Tower", plan(), base_version=base_version, by=ANNA)
        assert [each.version for each in await context.store.versions(head.id)] == [6, 5, 4]
        with pytest.raises(UnknownPlan, match="has no version 3"):
            await context.store.get(head.id, 3)

    run_with_store(tmp_path, work)


def test_number_and_size_of_plans_are_limited_and_deleted_plans_do_not_count(tmp_path, monkeypatch):
    monkeypatch.setattr(plan_store, "MAX_PLANS", 2)

    async def work(context):
        first = await context.store.create("a", plan(), by=ANNA)
        await context.store.create("b", plan(), by=ANNA)
        with pytest.raises(Refused, match="2 plans are stored"):
            await context.store.create("c", plan(), by=ANNA)
        await context.store.delete(first.id, base_version=1, by=ANNA)
        third = await context.store.create("c", plan(), by=ANNA)
        monkeypatch.setattr(plan_store, "MAX_TOTAL_BYTES", 1000)
        with pytest.raises(Refused, match="MB, which is the limit"):
            await context.store.save(third.id, "c", plan(item_count=50), base_version=1, by=ANNA)

    run_with_store(tmp_path, work)


def test_a_damaged_file_causes_a_warning_and_other_plans_stay_usable(tmp_path):
    async def work(context):
        intact = await context.store.create("good", plan(), by=ANNA)
        damaged = await context.store.create("bad", plan(), by=ANNA)
        (context.folder / damaged.id / "00000001.plan").write_bytes(b"\x00 damaged")
        reopened = PlanStore(context.folder, Clock(), EventFeed())
        assert [head.id for head in await reopened.all()] == [intact.id]
        assert damaged.id in reopened.warnings()[0]
        with pytest.raises(UnknownPlan):
            await reopened.save(damaged.id, "bad", plan(), base_version=1, by=BOB)
        reopened.close()

    run_with_store(tmp_path, work)


def test_a_folder_that_cannot_be_created_causes_a_readable_error(tmp_path):
    (tmp_path / "plans").write_text("a file")

    async def work(context):
        with pytest.raises(StorageError, match="cannot be used"):
            await context.store.create("Tower", plan(), by=ANNA)

    run_with_store(tmp_path, work)


def test_a_version_without_a_kind_is_a_waypoint_plan(tmp_path):
    async def work(context):
        created = await context.store.create("Tower", plan(), by=ANNA)
        file = context.folder / created.id / "00000001.plan"
        head, _, document = file.read_bytes().partition(b"\n")
        fields = json.loads(head)
        assert fields.pop("kind") == "waypoint_plan"
        file.write_bytes(json.dumps(fields).encode() + b"\n" + document)
        reopened = PlanStore(context.folder, Clock(), EventFeed())
        assert [head.kind for head in await reopened.all()] == ["waypoint_plan"]
        reopened.close()

    run_with_store(tmp_path, work)
