"""Agents: language models with tools, which call this server over MCP within the scope of each."""
