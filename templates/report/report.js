import { start } from "./move.js";

start();
