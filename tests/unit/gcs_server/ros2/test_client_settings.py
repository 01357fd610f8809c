"""Why no ROS 2 link finds a vehicle: its parameters, and the ports of PX4 and agent on one computer."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from gcs_server.ros2.agent_port import UdpSocket, agent_problems
from gcs_server.ros2.client_settings import explain

PX4 = {
    "UXRCE_DDS_DOM_ID": 0,
    "UXRCE_DDS_NS_IDX": -1,
    "UXRCE_DDS_PTCFG": 0,
    "UXRCE_DDS_AG_IP": -1062731518,
    "UXRCE_DDS_PRT": 8888,
}


def link(domain: int = 0, namespace: str | None = None, interface: str | None = None) -> Any:
    return SimpleNamespace(domain_id=domain, namespace=namespace, interface=interface)


@pytest.mark.parametrize(
    ("changed", "links", "said"),
    [
        ({"UXRCE_DDS_CFG": 0}, [link()], "its ROS 2 client is off (UXRCE_DDS_CFG is 0)."),
        ({"UXRCE_DDS_DOM_ID": 3}, [link(1)], "DDS domain 3 (UXRCE_DDS_DOM_ID), which no link reads; add ros2://3."),
        ({"UXRCE_DDS_NS_IDX": 2}, [link(namespace="uav_1")], "its namespace is /uav_2 (UXRCE_DDS_NS_IDX)"),
        ({"UXRCE_DDS_PTCFG": 1}, [link(interface="eth0")], "the agent's computer (UXRCE_DDS_PTCFG is 1)"),
        ({}, [link()], "an agent at 192.168.1.2, UDP port 8888 (UXRCE_DDS_AG_IP, UXRCE_DDS_PRT)"),
        ({"UXRCE_DDS_NS_IDX": 2}, [link(namespace="uav_2")], "does not reach an agent"),
        ({"UXRCE_DDS_PTCFG": 1}, [link()], "does not reach an agent"),
    ],
)  # fmt: skip
def test_the_parameter_that_keeps_a_vehicle_from_a_link_is_named(
    changed: dict[str, int], links: list[Any], said: str
) -> None:
    assert said in explain(PX4 | changed, links)


def test_two_causes_are_both_named_and_without_a_domain_nothing_is_said() -> None:
    text = explain(PX4 | {"UXRCE_DDS_CFG": 0, "UXRCE_DDS_DOM_ID": 3}, [link()])
    assert "UXRCE_DDS_CFG is 0" in text
    assert "ros2://3" in text
    assert explain({"UXRCE_DDS_CFG": 1}, [link()]) == ""


AGENT = UdpSocket("MicroXRCEAgent", 8889, 0, remote_is_local=False)
CLIENT = UdpSocket("px4", 40000, 8888, remote_is_local=True)


def test_a_client_that_looks_for_its_agent_on_another_port_is_named_with_the_agents() -> None:
    (text,) = agent_problems([AGENT, CLIENT])
    assert text.startswith(
        "PX4's client sends to UDP port 8888, where no program listens; an agent listens on 8889."
    )


def test_a_client_that_reaches_its_agent_is_no_problem() -> None:
    assert list(agent_problems([UdpSocket("MicroXRCEAgent", 8888, 0, remote_is_local=False), CLIENT])) == []
    other_computer = UdpSocket("px4", 40000, 7777, remote_is_local=False)
    assert list(agent_problems([other_computer, UdpSocket("", 8888, 0, remote_is_local=False)])) == []


def test_without_a_client_the_usual_port_is_looked_at_and_without_a_list_nothing_is_said() -> None:
    (text,) = agent_problems([AGENT])
    assert (
        text
        == "no program listens on UDP port 8888, the usual port of PX4's agent; an agent listens on 8889."
    )
    assert list(agent_problems([])) == []
